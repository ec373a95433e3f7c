// The conversation with the server, the pointer and the keys. It draws when there is something new.

import { Camera } from "./camera.js";
import { Stage } from "./draw.js";
import { Panel } from "./panel.js";

const CLICK = 4; // px that a pointer may move between press and release of a click
const SAID_FOR = 7000; // ms
const HEADER = 16; // bytes

const $ = (id) => document.getElementById(id);
const canvas = $("stage");
const camera = new Camera();
const stage = new Stage(canvas);
const panel = new Panel(say);

let socket = null;
let me = 0; // this page's number
let scene = null; // as stage.py describes it
let x = null; // positions [m]
let held = -1, holder = 0, frame = 0;
let received = 0, drawn = 0;
let stale = true; // what is on the screen is not what would be drawn now
let leading = false; // the cursor has moved since the last move was sent
let cursor = null; // [x, y] on the canvas, where it was last
let hovering = false; // whether it is there still: fingers and what left the canvas are not
let stretch = 0;
const pointers = new Map();

const mine = () => held >= 0 && holder === me;

function connect() {
  socket = new WebSocket(new URL("ws", location.href.replace(/^http/, "ws")));
  socket.binaryType = "arraybuffer";
  received = 0;
  socket.onmessage = ({ data }) => (data instanceof ArrayBuffer ? take(data) : hear(JSON.parse(data)));
  socket.onclose = ({ reason }) => {
    $("away").hidden = false;
    $("away").textContent = reason ? `The server has closed the connection: ${reason}.` : "Not connected. Is pbd-warp view running?";
    setTimeout(connect, 1000);
  };
}

function say(type, fields = {}) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ type, ...fields }));
}

function hear(message) {
  if (message.type === "hello") {
    me = message.you;
    $("away").hidden = true;
  } else if (message.type === "scene") {
    const other = scene?.scene !== message.scene;
    scene = message;
    x = null;
    stage.load(scene);
    panel.load(scene);
    if (other) camera.frame(scene.low, scene.high, scene.axis);
  } else if (message.type === "status") {
    panel.show(message);
    stretch = message.max_stretch ?? 0;
  } else {
    tell(message.text);
  }
  stale = true;
}

function tell(sentence) {
  const line = document.createElement("li");
  line.textContent = sentence;
  $("said").append(line);
  while ($("said").children.length > 4) $("said").firstChild.remove();
  setTimeout(() => line.remove(), SAID_FOR);
}

// A frame: generation, frame, held particle, page that holds it; positions.
function take(data) {
  received++;
  acknowledge();
  stale = true;
  const header = new DataView(data, 0, HEADER);
  if (!scene || header.getUint32(0, true) !== scene.generation) return;
  frame = header.getUint32(4, true);
  held = header.getInt32(8, true);
  holder = header.getUint32(12, true);
  x = new Float32Array(data, HEADER);
}

// What one of the 1-2-5 steps above the largest stretch is white to red.
function stretchScale() {
  const least = Math.max(stretch, 1e-4);
  const ten = 10 ** Math.floor(Math.log10(least));
  return ten * [1, 2, 5, 10].find((step) => step * ten >= least * (1 - 1e-9));
}

function animate() {
  requestAnimationFrame(animate);
  if (leading && mine()) say("move", { camera: camera.describe(), at: cursor });
  leading = leading && !mine();
  if (!stale || !x) return;
  stale = false;
  const scale = $("by-stretch").checked ? stretchScale() : 0;
  $("legend").hidden = scale === 0;
  $("legend-low").textContent = `−${+(100 * scale).toPrecision(1)} %`;
  $("legend-high").textContent = `+${+(100 * scale).toPrecision(1)} %`;
  stage.draw(camera, x, held, scale);
  ring();
  drawn++;
}

// The server sends only as fast as this says that frames arrive. It is not said while nobody looks.
function acknowledge() {
  if (document.hidden) return;
  say("seen", { count: received });
}
document.addEventListener("visibilitychange", acknowledge);

// A ring around the held particle, or around the one that a click would select.
function ring() {
  const down = pointers.size > 0;
  const near = held < 0 && hovering && !down ? camera.nearest(x, scene.radius, cursor) : -1;
  const shown = held >= 0 ? held : near;
  const element = $("ring");
  canvas.classList.toggle("near", near >= 0);
  canvas.classList.toggle("holding", mine() && !down);
  element.hidden = shown < 0;
  if (shown < 0) return;
  const [px, py, depth] = camera.project(x, shown);
  const size = 2 * Math.max(9, scene.radius[shown] * camera.scale / depth + 5);
  element.hidden = !(depth > 0);
  element.className = held < 0 ? "" : mine() ? "held" : "other";
  element.style.width = element.style.height = `${size}px`;
  element.style.transform = `translate(${px - size / 2}px, ${py - size / 2}px)`;
}

const place = (event) => {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
};

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  document.activeElement?.blur();
  const touch = event.pointerType === "touch";
  const doing = event.button !== 0 || event.shiftKey ? "pan" : touch && mine() ? "lead" : "turn";
  const at = place(event);
  pointers.set(event.pointerId, { at, start: at, doing, moved: false, button: event.button });
  if (pointers.size > 1) for (const pointer of pointers.values()) pointer.moved = true; // no tap comes of two fingers
});

canvas.addEventListener("pointermove", (event) => {
  const at = place(event);
  const pointer = pointers.get(event.pointerId);
  hovering = event.pointerType !== "touch";
  stale = true; // the ring
  if (!pointer) {
    cursor = at;
    leading = true;
    return;
  }
  const [before, start] = [pointer.at, pointer.start];
  pointer.moved ||= Math.hypot(at[0] - start[0], at[1] - start[1]) > CLICK;
  if (!pointer.moved) return;
  pointer.at = at;
  const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
  if (pointers.size === 2) {
    const [other] = [...pointers.values()].filter((one) => one !== pointer);
    const apart = (place) => Math.hypot(place[0] - other.at[0], place[1] - other.at[1]);
    camera.zoom(apart(before) / Math.max(1, apart(at)));
    camera.pan(dx / 2, dy / 2);
  } else if (pointer.doing === "lead") {
    cursor = at;
    leading = true;
  } else if (pointer.doing === "turn") {
    camera.turn(dx, dy);
    canvas.classList.add("turning");
  } else {
    camera.pan(dx, dy);
  }
});

canvas.addEventListener("pointerup", (event) => {
  const pointer = pointers.get(event.pointerId);
  lift(event);
  if (!pointer || pointer.moved || pointer.button !== 0) return;
  cursor = place(event);
  leading = false; // it is where it was pressed: nothing to lead
  say("click", { camera: camera.describe(), at: cursor });
  $("hint").classList.add("done");
});
canvas.addEventListener("pointercancel", lift);

function lift(event) {
  pointers.delete(event.pointerId);
  canvas.classList.remove("turning");
  stale = true;
}

canvas.addEventListener("pointerleave", () => {
  hovering = false;
  stale = true;
});

canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  camera.zoom(Math.exp(0.0015 * Math.max(-200, Math.min(200, event.deltaY * (event.deltaMode ? 30 : 1)))));
  leading = pointers.size === 0; // what is held stays under the cursor
  stale = true;
}, { passive: false });

canvas.addEventListener("mousedown", (event) => event.preventDefault()); // the middle one would scroll
canvas.addEventListener("contextmenu", (event) => event.preventDefault());

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "Escape") say("release");
  if (event.target.matches("select")) return; // in which letters choose
  if (event.key === " ") panel.togglePause();
  else if (event.key === "s") say("step");
  else if (event.key === "r") say("reset");
  else return;
  event.preventDefault();
});

$("by-stretch").addEventListener("change", () => { stale = true; $("by-stretch").blur(); });

new ResizeObserver(() => {
  const box = canvas.getBoundingClientRect();
  const first = camera.width === 1;
  canvas.width = Math.round(box.width * devicePixelRatio);
  canvas.height = Math.round(box.height * devicePixelRatio);
  camera.resize(box.width, box.height);
  if (first && scene) camera.frame(scene.low, scene.high, scene.axis);
  stale = true;
}).observe(canvas);

// For tests, and for the curious.
window.pbd = {
  // Where a particle is in the window [px].
  project(particle) {
    const box = canvas.getBoundingClientRect();
    const [px, py] = camera.project(x, particle);
    return [px + box.left, py + box.top];
  },
  get ready() { return x !== null && drawn > 0; },
  get frame() { return frame; },
  get drawn() { return drawn; },
  get held() { return held; },
  get holder() { return holder; },
  get me() { return me; },
  get count() { return x ? x.length / 3 : 0; },
  get positions() { return Array.from(x); },
  get camera() { return camera.describe(); },
};

connect();
requestAnimationFrame(animate);
