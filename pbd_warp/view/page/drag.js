// Pointers on the canvas: they grab and drag particles, and turn, shift and zoom the camera.
//
// A click takes a particle until the next click; a press that moves takes it until it ends. Which particle that is, is
// decided here, by what the user sees, and where it is to be: the server gets particle, frame and position.

const CLICK = 4; // px that a pointer may move between press and release of a click
const UNANSWERED = 3000; // ms

export class Dragging {
  // view: scene, camera, shown ({ x, number }), say(type, fields), redraw(), moved(): by hand. rope: takes presses while
  // one is drawn.
  constructor(canvas, view, rope) {
    Object.assign(this, { canvas, view, rope });
    this.pointers = new Map();
    this.grab = null; // { particle, target, confirmed, since }: what this page holds
    this.cursor = null; // [x, y] on the canvas, where it was last
    this.hovering = false; // whether it is there still: fingers and what left the canvas are not
    this.leading = false; // the cursor has moved since the last move was sent
    const on = (type, act, options) => canvas.addEventListener(type, act, options);
    on("pointerdown", (event) => this.press(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.lift(event));
    on("pointercancel", (event) => this.lift(event, true));
    on("pointerleave", () => { this.hovering = false; view.redraw(); });
    on("wheel", (event) => this.wheel(event), { passive: false });
    on("mousedown", (event) => event.preventDefault()); // the middle one would scroll
    on("contextmenu", (event) => event.preventDefault());
  }

  get down() {
    return this.pointers.size > 0;
  }

  // The particle that a press would take, or -1.
  get near() {
    const { view } = this;
    if (this.grab || view.held >= 0 || !this.hovering || this.down || this.rope.active || !view.shown) return -1;
    return view.camera.nearest(view.shown.x, view.scene.radius, this.cursor);
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    document.activeElement?.blur();
    const at = this.place(event);
    const pointer = { at, start: at, doing: "turn", moved: false, took: false };
    if (event.button !== 0 || event.shiftKey) pointer.doing = "pan";
    else if (this.rope.active) pointer.doing = "draw";
    else if (this.pointers.size === 0) {
      if (!this.grab) pointer.took = this.take(at);
      if (this.grab) pointer.doing = "lead";
    }
    this.pointers.set(event.pointerId, pointer);
    if (this.pointers.size > 1) {
      for (const other of this.pointers.values()) {
        if (other.took) this.release();
        Object.assign(other, { moved: true, took: false, doing: "turn" }); // no tap comes of two fingers
      }
    }
    this.cursor = at;
    this.leading = false; // nothing has moved yet
    this.view.redraw();
  }

  take(at) {
    const { view } = this;
    if (!view.shown) return false;
    const { x, number } = view.shown;
    const particle = view.camera.nearest(x, view.scene.radius, at);
    if (particle < 0) return false;
    const target = [x[3 * particle], x[3 * particle + 1], x[3 * particle + 2]];
    this.grab = { particle, target, confirmed: false, since: performance.now() };
    view.say("select", { particle, frame: number, generation: view.scene.generation });
    return true;
  }

  release() {
    if (!this.grab) return;
    this.grab = null;
    this.view.say("release");
    this.view.redraw();
  }

  // What the server says of who holds what.
  confirm(held, holder, me) {
    const { grab } = this;
    if (!grab) return;
    const mine = held === grab.particle && holder === me;
    if (mine) grab.confirmed = true;
    else if (grab.confirmed || performance.now() - grab.since > UNANSWERED) this.grab = null;
  }

  // Something was refused: maybe what this page wanted to hold.
  refused() {
    if (this.grab && !this.grab.confirmed) this.grab = null;
  }

  // Once a picture: send where what is held is to be, if the cursor has moved.
  lead() {
    if (!this.grab) this.leading = false;
    if (!this.leading) return;
    this.leading = false;
    const target = this.view.camera.unproject(this.cursor, this.grab.target);
    if (!target) return;
    this.grab.target = target;
    this.view.say("move", { position: target });
  }

  move(event) {
    const { view } = this;
    const at = this.place(event);
    const pointer = this.pointers.get(event.pointerId);
    this.hovering = event.pointerType !== "touch";
    view.redraw(); // the ring
    if (!pointer) {
      this.cursor = at;
      this.leading = true;
      return;
    }
    const [before, start] = [pointer.at, pointer.start];
    pointer.moved ||= Math.hypot(at[0] - start[0], at[1] - start[1]) > CLICK;
    if (!pointer.moved) return;
    pointer.at = at;
    const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
    if (this.pointers.size === 2) {
      const [other] = [...this.pointers.values()].filter((one) => one !== pointer);
      const apart = (place) => Math.hypot(place[0] - other.at[0], place[1] - other.at[1]);
      view.camera.zoom(apart(before) / Math.max(1, apart(at)));
      view.camera.pan(dx / 2, dy / 2);
      view.moved();
    } else if (pointer.doing === "lead") {
      this.cursor = at;
      this.leading = true;
    } else if (pointer.doing === "pan") {
      view.camera.pan(dx, dy);
      view.moved();
    } else {
      view.camera.turn(dx, dy);
      view.moved();
    }
  }

  lift(event, cancelled = false) {
    const pointer = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    this.view.redraw();
    if (!pointer) return;
    if (pointer.doing === "draw" && !pointer.moved && !cancelled) this.rope.click(this.place(event));
    if (pointer.doing !== "lead") return;
    // What was taken by a click is let go of by a click, what was taken by a drag by its end.
    if (pointer.took === pointer.moved) {
      this.lead();
      this.release();
    }
    this.view.touched();
  }

  wheel(event) {
    event.preventDefault();
    this.view.camera.zoom(Math.exp(0.0015 * Math.max(-200, Math.min(200, event.deltaY * (event.deltaMode ? 30 : 1)))));
    this.leading = !this.down; // what is held stays under the cursor
    this.view.moved();
  }
}
