// Plays the frames that are in this page. Between two frames it goes on evenly.

import { Camera } from "./camera.js";
import { colouring, largest } from "./colour.js";
import { Drawing, THEMES } from "./draw.js";
import { onSchemeChange, scheme } from "./theme.js";

const $ = (id) => document.getElementById(id);
const scene = JSON.parse($("scene").textContent);
const canvas = $("stage");
const count = 3 * scene.radius.length;
const last = scene.frames - 1;
const camera = new Camera();
const pointers = new Map(); // id: where it was
const x = new Float32Array(count), tension = new Float32Array(scene.links.length); // as shown
let frames = null, tensions = null;
let drawing = null;
let at = 0; // the frame shown, a fraction between two
let playing = false;
let before = null; // time of the last animation frame [ms]
let stale = true;
let drawn = 0;
const most = {}; // largest stretch and tension that there are

async function unpack(id) {
  const bytes = Uint8Array.from(atob($(id).textContent), (char) => char.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Float32Array(await new Response(stream).arrayBuffer());
}

// Of all frames and links; those that should have no length have no stretch.
function largestStretch() {
  let most = 0;
  for (let start = 0; start < frames.length; start += count) {
    scene.links.forEach(([i, j], k) => {
      if (scene.rest_length[k] <= 0) return;
      const [a, b] = [start + 3 * i, start + 3 * j];
      const far = Math.hypot(frames[a] - frames[b], frames[a + 1] - frames[b + 1], frames[a + 2] - frames[b + 2]);
      most = Math.max(most, Math.abs(far / scene.rest_length[k] - 1));
    });
  }
  return most;
}

function place() {
  const frame = Math.min(Math.floor(at), Math.max(last - 1, 0));
  const next = Math.min(frame + 1, last);
  const part = at - frame;
  const mix = (to, from) => {
    const [a, b] = [frame, next].map((number) => number * to.length);
    for (let k = 0; k < to.length; k++) to[k] = (1 - part) * from[a + k] + part * from[b + k];
  };
  mix(x, frames);
  if (scene.has_tension) mix(tension, tensions);
}

function animate(now) {
  requestAnimationFrame(animate);
  if (playing && before !== null) {
    go(at + (now - before) / 1000 * scene.fps * Number($("speed").value));
    if (at >= last) setPlaying(false);
  }
  before = now;
  if (!stale) return;
  stale = false;
  place();
  const by = $("colour").value;
  drawing.draw(camera, x, -1, colouring(by, most[by], tension), at / scene.fps);
  drawn++;
}

function go(frame) {
  at = Math.min(last, Math.max(0, frame));
  $("time").value = at;
  $("clock").textContent = `${(at / scene.fps).toFixed(2)} of ${(last / scene.fps).toFixed(2)} s`;
  stale = true;
}

function setPlaying(on) {
  if (on && at >= last) go(0);
  playing = on;
  $("play").classList.toggle("playing", on);
}

function fit() {
  camera.frame(scene.low, scene.high, scene.axis);
  stale = true;
}

$("play").addEventListener("click", () => setPlaying(!playing));
$("time").addEventListener("input", () => { setPlaying(false); go($("time").valueAsNumber); });
$("colour").addEventListener("change", () => {
  const by = $("colour").value;
  if (by) most[by] ??= by === "stretch" ? largestStretch() : largest(tensions);
  $("legend-of").textContent = by === "stretch" ? `of ${scene.stretch_from}` : "pull and push";
  $("colour").blur(); // so that space is play again
  stale = true;
});
$("fit").addEventListener("click", fit);

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return;
  if (event.key === " ") setPlaying(!playing);
  else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
    setPlaying(false);
    go(Math.round(at) + (event.key === "ArrowLeft" ? -1 : 1));
  } else if (event.key === "Home") go(0);
  else if (event.key === "End") go(last);
  else if (event.key === "f") fit();
  else return;
  event.preventDefault();
});

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
});

canvas.addEventListener("pointermove", (event) => {
  const from = pointers.get(event.pointerId);
  if (!from) return;
  const to = [event.clientX, event.clientY];
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  if (pointers.size === 2) {
    const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, where]) => where);
    const apart = (where) => Math.hypot(where[0] - other[0], where[1] - other[1]);
    camera.zoom(apart(from) / Math.max(1, apart(to)));
    camera.pan(dx / 2, dy / 2);
  } else if (event.shiftKey || (event.buttons & 1) === 0) camera.pan(dx, dy);
  else camera.turn(dx, dy);
  pointers.set(event.pointerId, to);
  stale = true;
});

for (const end of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
}

canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  camera.zoom(Math.exp(0.0015 * Math.max(-200, Math.min(200, event.deltaY * (event.deltaMode ? 30 : 1)))));
  stale = true;
}, { passive: false });
canvas.addEventListener("contextmenu", (event) => event.preventDefault());

function resize() {
  const box = canvas.getBoundingClientRect();
  const first = camera.width === 1;
  canvas.width = Math.round(box.width * devicePixelRatio);
  canvas.height = Math.round(box.height * devicePixelRatio);
  camera.resize(box.width, box.height);
  if (first) fit();
  stale = true;
}

async function start() {
  $("colour").parentElement.hidden = scene.links.length === 0;
  $("colour").querySelector("[value=tension]").hidden = !scene.has_tension;
  $("time").max = last;
  try {
    drawing = new Drawing(canvas, THEMES[scheme()]);
    onSchemeChange(() => { drawing.paint(THEMES[scheme()]); stale = true; });
    [frames, tensions] = await Promise.all([unpack("frames"), unpack("tension")]);
  } catch (error) {
    $("trouble").textContent = `This page cannot be shown here: ${error.message}`;
    $("trouble").hidden = false;
    return;
  }
  drawing.load(scene);
  resize();
  new ResizeObserver(resize).observe(canvas);
  go(0);
  setPlaying(last > 0);
  requestAnimationFrame(animate);
}

// For tests, and for the curious.
window.pbd = {
  get ready() { return drawn > 0; },
  get playing() { return playing; },
  get frame() { return at; },
  get frames() { return scene.frames; },
  get positions() { return Array.from(x); },
  get tension() { return Array.from(tension); },
  get most() { return most; },
  get camera() { return { eye: camera.eye, forward: camera.forward }; },
  go,
};

start();
