// The conversation with the server, the keys, and what is drawn when.

import { boxOf, Camera, sizeOf } from "./camera.js";
import { colouring, largest } from "./colour.js";
import { Dragging } from "./drag.js";
import { Drawing, THEMES } from "./draw.js";
import { Messages } from "./messages.js";
import { Follower } from "./follow.js";
import { length, Panel } from "./panel.js";
import { Playhead } from "./play.js";
import { RopeDrawing } from "./rope.js";
import { linkTo, SceneDialog, takeLink } from "./scenes.js";
import { onSchemeChange, scheme } from "./theme.js";

const HEADER = 28; // bytes
const FAR = 10; // px between a held particle and the cursor, above which a line joins them

const $ = (id) => document.getElementById(id);
const canvas = $("picture");
const drawing = draws();
const camera = new Camera();
const follower = new Follower(camera);
const playhead = new Playhead();
const panel = new Panel(say);
const messages = new Messages(say);

function draws() {
  try {
    return new Drawing(canvas, THEMES[scheme()]);
  } catch (error) {
    Object.assign($("away"), { hidden: false, textContent: `Nothing can be drawn: ${error.message}` });
    throw error;
  }
}

let socket = null;
let me = 0; // this page's number
let status = null;
let held = -1, holder = 0, target = [0, 0, 0]; // who is held by which page, and pulled to where
let received = 0, drawn = 0;
let pull = 0; // the largest tension seen lately [N]
let stale = true; // what is on the screen is not what would be drawn now
const link = takeLink();
let wanted = link;

// What Dragging and RopeDrawing are handed.
const view = {
  scene: null, // as surroundings.py and report.py describe it
  shown: null, // { x, tension, number }: positions [m] and tensions [N] that are drawn, and the frame they are of
  camera,
  get held() { return held; },
  say,
  redraw() { stale = true; },
  moved() { follower.end(); stale = true; },
  touched() { $("hint").classList.add("done"); },
};
const rope = new RopeDrawing(view, $("rope"), $("drawn"));
const dragging = new Dragging(canvas, view, rope);
new SceneDialog(() => view.scene, say);

function connect() {
  socket = new WebSocket(new URL("ws", location.href.replace(/^http/, "ws").replace(/#.*/, "")));
  socket.binaryType = "arraybuffer";
  received = 0;
  socket.onmessage = ({ data }) => (data instanceof ArrayBuffer ? take(data) : hear(JSON.parse(data)));
  socket.onclose = ({ code, reason }) => {
    dragging.grab = null;
    messages.busy(null);
    messages.away(code, reason);
    setTimeout(connect, 1000);
  };
}

function say(type, fields = {}) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ type, ...fields }));
}

function hear({ type, ...message }) {
  if (type === "hello") {
    me = message.you;
    messages.here();
  } else if (type === "busy") {
    messages.busy(message.text, message.compiling);
  } else if (type === "scene") {
    load(message);
  } else if (type === "status") {
    status = message;
    panel.show(message);
    messages.status(message);
  } else {
    dragging.refused();
    messages.tell(message.text, message.remedies);
  }
  stale = true;
}

function load(scene) {
  if (wanted) {
    say("open", wanted);
    wanted = null;
  }
  const other = view.scene?.scene !== scene.scene;
  view.scene = scene;
  view.shown = null;
  pull = 0;
  playhead.clear();
  drawing.load(scene);
  panel.load(scene);
  if (other) frame();
}

// Face-on, everything in sight.
function frame() {
  const { low, high, axis } = view.scene;
  camera.frame(low, high, axis);
  follower.begin(low, high);
}

// Everything in sight, from where one looks.
function fit() {
  if (!view.shown) return;
  const { low, high } = view.scene;
  const [lowest, highest] = boxOf(view.shown.x, view.scene.radius);
  const both = [low.map((value, k) => Math.min(value, lowest[k])), high.map((value, k) => Math.max(value, highest[k]))];
  const [from, to] = sizeOf(...both) > 4 * sizeOf(low, high) ? [lowest, highest] : both;
  camera.fit(from, to);
  follower.begin(from, to);
  stale = true;
}

// A frame: generation, frame, held particle, page that holds it, where it is pulled to; positions; tensions, if known.
function take(data) {
  received++;
  acknowledge();
  const header = new DataView(data, 0, HEADER);
  if (!view.scene || header.getUint32(0, true) !== view.scene.generation) return;
  held = header.getInt32(8, true);
  holder = header.getUint32(12, true);
  target = [16, 20, 24].map((at) => header.getFloat32(at, true));
  dragging.confirm(held, holder, me);
  playhead.add(header.getUint32(4, true), new Float32Array(data, HEADER), performance.now() / 1000);
  stale = true;
}

// What is to be seen of a frame, as the playhead gives it.
function apart(frame) {
  const count = 3 * view.scene.radius.length;
  if (!frame) return frame;
  return { x: frame.x.subarray(0, count), tension: frame.x.subarray(count), number: frame.number, at: frame.at };
}

// How links are coloured now.
function linkColours() {
  const { tension } = view.shown;
  const by = $("colour").value;
  if (by !== "tension") return colouring(by, status?.max_stretch ?? 0);
  pull = Math.max(largest(tension), 0.99 * pull);
  return colouring(tension.length ? by : "", pull, tension);
}

function animate(now) {
  requestAnimationFrame(animate);
  dragging.lead();
  if (!stale || !view.scene) return;
  view.shown = apart(playhead.show(now / 1000, !status || status.paused || status.failure !== null));
  stale = !playhead.atEnd;
  if (!view.shown) {
    drawing.clear();
    return;
  }
  if (!dragging.down && !dragging.grab && follower.step(...boxOf(view.shown.x, view.scene.radius))) stale = true;
  drawing.draw(camera, view.shown.x, held, linkColours(), view.shown.at / view.scene.fps);
  mark();
  drawn++;
}

// The server sends only as fast as this says that frames arrive. It is not said while nobody looks.
function acknowledge() {
  if (document.hidden) return;
  say("seen", { count: received });
}
document.addEventListener("visibilitychange", acknowledge);

// A ring around the held particle, or around the one that a press would take; a line to where it is pulled; the scale.
function mark() {
  const mine = dragging.grab !== null;
  const near = dragging.near;
  const shown = mine ? dragging.grab.particle : held >= 0 ? held : near;
  const [element, line] = [$("ring"), $("pull")];
  canvas.classList.toggle("near", near >= 0);
  canvas.classList.toggle("holding", mine);
  canvas.classList.toggle("drawing", rope.active);
  element.hidden = shown < 0;
  line.toggleAttribute("hidden", true);
  if (rope.active) rope.draw();
  bar();
  if (shown < 0) return;
  const [px, py, depth] = camera.project(view.shown.x, shown);
  const size = 2 * Math.max(9, view.scene.radius[shown] / camera.metres(depth) + 5);
  element.hidden = !(depth > 0);
  element.className = near >= 0 ? "" : mine ? "held" : "other";
  element.style.width = element.style.height = `${size}px`;
  element.style.transform = `translate(${px - size / 2}px, ${py - size / 2}px)`;
  const [tx, ty, away] = camera.project(mine ? dragging.grab.target : target, 0);
  if (near >= 0 || !(away > 0) || Math.hypot(tx - px, ty - py) < FAR) return;
  for (const [name, value] of Object.entries({ x1: px, y1: py, x2: tx, y2: ty })) line.setAttribute(name, value);
  line.toggleAttribute("hidden", false);
}

// How long a round number of metres is, where the scene lies.
function bar() {
  const metres = camera.metres(camera.ortho ? 1 : camera.distance);
  const ten = 10 ** Math.floor(Math.log10(120 * metres));
  const round = ten * [5, 2, 1].find((step) => step * ten <= 120 * metres);
  $("scale").querySelector("span").textContent = length(round);
  $("scale").querySelector("i").style.width = `${round / metres}px`;
}

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
  if (event.key === "Escape") rope.active ? rope.stop() : dragging.grab ? dragging.release() : say("release");
  if (event.target.matches("select, input[type=number], input[type=text]")) return;
  const act = {
    " ": () => panel.togglePause(), s: () => say("step"), r: () => say("reset"), f: fit, "?": () => $("help").showModal(),
    ...(rope.active ? { Enter: () => rope.finish(), Backspace: () => rope.undo() } : {}),
  }[event.key];
  if (!act) return;
  act();
  event.preventDefault();
});

panel.button($("fit"), fit);
panel.button($("draw"), () => (rope.active ? rope.stop() : rope.start()));
panel.button($("ask"), () => $("help").showModal());
panel.button($("save-picture"), () => {
  drawing.draw(camera, view.shown.x, held, linkColours(), view.shown.at / view.scene.fps); // it is gone from the buffer
  canvas.toBlob((picture) => {
    const name = `${view.scene.scene}-${view.shown.number}.png`;
    const save = Object.assign(document.createElement("a"), { href: URL.createObjectURL(picture), download: name });
    save.click();
    setTimeout(() => URL.revokeObjectURL(save.href), 10000);
  });
});
panel.button($("copy-link"), () => messages.copy(linkTo(view.scene, status)));
$("colour").addEventListener("change", () => { stale = true; $("colour").blur(); });
onSchemeChange(() => { drawing.paint(THEMES[scheme()]); panel.plot.draw(); stale = true; });

new ResizeObserver(() => {
  const box = canvas.getBoundingClientRect();
  const first = camera.width === 1;
  canvas.width = Math.round(box.width * devicePixelRatio);
  canvas.height = Math.round(box.height * devicePixelRatio);
  camera.resize(box.width, box.height);
  if (view.scene && (first || follower.on)) frame();
  stale = true;
}).observe(canvas);

// For tests, and for the curious.
window.pbd = {
  // Where a particle is in the window [px].
  project(particle) {
    const box = canvas.getBoundingClientRect();
    const [px, py] = camera.project(view.shown.x, particle);
    return [px + box.left, py + box.top];
  },
  get ready() { return view.shown !== null && drawn > 0; },
  get frame() { return playhead.newest?.number ?? -1; },
  get drawn() { return drawn; },
  get held() { return held; },
  get holder() { return holder; },
  get me() { return me; },
  get count() { return view.shown ? view.shown.x.length / 3 : 0; },
  get positions() { return Array.from(view.shown.x); },
  get tension() { return Array.from(view.shown.tension); },
  get shown() { return view.shown.number; },
  get paused() { return status?.paused ?? false; },
  get scene() { return view.scene.scene; },
  get camera() { return camera; },
  tell: (sentence) => void messages.tell(sentence),
};

panel.fold(matchMedia("(max-width: 720px)").matches); // the picture first
connect();
requestAnimationFrame(animate);
