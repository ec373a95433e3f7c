// Draws a rope by hand: points in the picture's plane, by clicks; a click on a point pins it, or frees it.

const NEAR = 16; // px, to a point that is meant

export class RopeDrawing {
  constructor(view, bar, overlay) {
    Object.assign(this, { view, bar, overlay, points: [], pinned: new Set(), active: false });
    const act = { done: () => this.finish(), undo: () => this.undo(), cancel: () => this.stop() };
    for (const button of bar.querySelectorAll("button")) button.addEventListener("click", act[button.dataset.rope]);
  }

  start() {
    Object.assign(this, { points: [], pinned: new Set(), active: true });
    this.bar.hidden = false;
    this.view.touched(); // the hint is in its place
    this.draw();
  }

  stop() {
    this.active = false;
    this.bar.hidden = true;
    this.points = [];
    this.draw();
  }

  click(at) {
    const { camera } = this.view;
    const near = this.points.findIndex((point) => {
      const [px, py] = camera.project(point, 0);
      return Math.hypot(px - at[0], py - at[1]) <= NEAR;
    });
    if (near < 0) this.points.push(camera.unproject(at, camera.target));
    else if (!this.pinned.delete(near)) this.pinned.add(near);
    this.draw();
  }

  undo() {
    this.points.pop();
    this.pinned.delete(this.points.length);
    this.draw();
  }

  finish() {
    if (this.points.length < 2) return;
    this.view.say("rope", { points: this.points, pinned: [...this.pinned] });
    this.stop();
  }

  // Also when the camera has moved.
  draw() {
    this.bar.querySelector("[data-rope=done]").disabled = this.points.length < 2;
    this.bar.querySelector("[data-rope=undo]").disabled = this.points.length < 1;
    const places = this.points.map((point) => this.view.camera.project(point, 0));
    const line = element("polyline", { points: places.map(([x, y]) => `${x},${y}`).join(" ") });
    const dots = places.map(([cx, cy], k) => element("circle", { cx, cy, r: 6, class: this.pinned.has(k) ? "pin" : "" }));
    this.overlay.replaceChildren(...(this.active ? [line, ...dots] : []));
  }
}

function element(name, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}
