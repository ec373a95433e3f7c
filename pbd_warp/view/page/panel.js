// The panel: settings that are sent when they are changed, figures that are shown when they arrive.

const $ = (id) => document.getElementById(id);
const EVERY = 150; // ms between two changes while a slider moves
const SHOWN = 240; // energies in the plot

const text = {
  stiffness: (value) => value.toFixed(2),
  damping: (value) => value.toFixed(2),
  gravity: (value) => `${value.toFixed(2)} m/s²`,
};

export class Panel {
  // say(type, fields): to the server.
  constructor(say) {
    this.say = say;
    this.energies = [];
    this.editing = null;
    this.sent = 0;
    for (const button of document.querySelectorAll("[data-say]")) this.button(button, () => say(button.dataset.say));
    this.button($("pause"), () => this.togglePause());
    this.button($("defaults"), () => say("load", { scene: $("scene").value }));
    $("scene").addEventListener("change", () => { say("load", { scene: $("scene").value }); $("scene").blur(); });
    for (const id of ["method", "integrator"]) {
      $(id).addEventListener("change", () => { this.change(id, $(id).value); $(id).blur(); });
    }
    for (const id of ["substeps", "iterations"]) {
      $(id).addEventListener("input", () => { this.editing = id; });
      $(id).addEventListener("change", () => this.change(id, Number($(id).value)));
    }
    for (const id of ["stiffness", "damping", "gravity"]) {
      $(id).addEventListener("input", () => {
        this.editing = id;
        this.label(id, Number($(id).value));
        if (performance.now() - this.sent > EVERY) this.slide(id);
      });
      $(id).addEventListener("change", () => { this.slide(id); this.editing = null; });
    }
  }

  button(element, act) {
    element.addEventListener("click", () => { act(); element.blur(); }); // so that space is pause again
  }

  togglePause() {
    this.say("pause", { on: !this.paused });
  }

  change(name, value) {
    this.editing = null;
    this.sent = performance.now();
    this.say("change", { changes: { [name]: value } });
  }

  slide(id) {
    const value = Number($(id).value);
    const editing = this.editing;
    this.change(id, id === "gravity" ? [this.gravity[0], value, this.gravity[2]] : value);
    this.editing = editing;
  }

  label(id, value) {
    $(id).parentElement.querySelector("output").textContent = value === null ? "–" : text[id](value);
  }

  load(scene) {
    choices($("scene"), scene.scenes, scene.scene);
    choices($("method"), scene.methods);
    choices($("integrator"), scene.integrators);
    document.title = `${scene.scene} · pbd-warp`;
    this.energies = [];
    this.editing = null;
    $("stiffness").disabled = scene.links.length === 0;
  }

  show(status) {
    this.paused = status.paused;
    this.gravity = status.settings.gravity;
    for (const id of ["method", "integrator", "substeps", "iterations"]) {
      if (this.editing !== id) $(id).value = status.settings[id];
    }
    for (const id of ["stiffness", "damping", "gravity"]) {
      if (this.editing === id) continue;
      const value = id === "gravity" ? this.gravity[1] : status.settings[id];
      $(id).value = value ?? 1;
      this.label(id, value);
    }
    $("pause").textContent = status.paused ? "Go on" : "Pause";
    const figure = (value, digits, unit, factor = 1) => (value === null ? "–" : `${short(factor * value, digits)} ${unit}`);
    $("frame").textContent = `${status.frame} · ${status.time.toFixed(2)} s`;
    $("ms").textContent = figure(status.ms, 3, "ms");
    $("stretch").textContent = figure(status.max_stretch, 3, "%", 100);
    $("residual").textContent = length(status.residual);
    $("energy").textContent = figure(status.energy, 4, "J");
    const watching = status.pages > 1 ? ` · ${status.pages} pages` : "";
    const percent = status.speed === null ? "" : ` · ${Math.round(100 * status.speed)} %`;
    $("pace").classList.toggle("late", !status.keeps_up);
    $("pace").textContent = (status.failure !== null ? "stopped" : status.paused ? "paused"
      : status.keeps_up ? `real time${percent}` : `cannot keep up${percent} of real time`) + watching;
    $("failure").hidden = status.failure === null;
    $("failure").querySelector("p").textContent = status.failure ?? "";
    const [, launches] = /launches a frame\s+(\d+)/.exec(status.cost);
    $("launches").textContent = `${launches} launches a frame`;
    if ($("cost").textContent !== status.cost) $("cost").textContent = status.cost;
    if (status.frame < this.lastFrame) this.energies = [];
    if (status.energy !== null && status.frame !== this.lastFrame) this.energies.push(status.energy);
    this.lastFrame = status.frame;
    this.energies.splice(0, this.energies.length - SHOWN);
    this.plot();
  }

  plot() {
    const canvas = $("plot");
    const ratio = window.devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio)) [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    if (this.energies.length < 2) return;
    let [low, high] = [Math.min(...this.energies), Math.max(...this.energies)];
    const least = 1e-9 + 1e-3 * Math.max(Math.abs(low), Math.abs(high)); // rounding is drawn as a straight line
    if (high - low < least) [low, high] = [0.5 * (low + high - least), 0.5 * (low + high + least)];
    const x = (k) => width * (1 - (this.energies.length - 1 - k) / (SHOWN - 1));
    const y = (value) => 4 + (height - 8) * (high - value) / (high - low);
    pen.beginPath();
    this.energies.forEach((value, k) => pen.lineTo(x(k), y(value)));
    pen.strokeStyle = "#f2935c";
    pen.lineWidth = 1.5;
    pen.lineJoin = "round";
    pen.stroke();
    pen.lineTo(width, height);
    pen.lineTo(x(0), height);
    pen.fillStyle = "rgb(242 147 92 / .12)";
    pen.fill();
  }
}

const short = (value, digits) => (value !== 0 && Math.abs(value) < 1e-3 ? value.toExponential(1) : String(+value.toPrecision(digits)));

function length(metres) {
  if (metres === null) return "–";
  const [unit, factor] = metres >= 1 || metres === 0 ? ["m", 1] : metres >= 1e-3 ? ["mm", 1e3] : ["µm", 1e6];
  return `${short(factor * metres, 3)} ${unit}`;
}

function choices(select, names, chosen) {
  select.replaceChildren(...names.map((name) => new Option(name, name)));
  if (chosen !== undefined) select.value = chosen;
}
