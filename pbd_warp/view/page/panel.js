// The panel: settings that are sent when they are changed, figures that are shown when they arrive.

import { Plot } from "./plot.js";

const $ = (id) => document.getElementById(id);
const EVERY = 150; // ms between two changes while a slider moves
const GRABS = [["25", "gentle"], ["100", "normal"], ["400", "strong"], ["exact", "exact"]]; // m/s^2

const text = {
  stiffness: (value) => value.toFixed(2),
  damping: (value) => value.toFixed(2),
  gravity: (value) => `${value.toFixed(2)} m/s²`,
};

export class Panel {
  // say(type, fields): to the server.
  constructor(say) {
    this.say = say;
    this.plot = new Plot($("plot"), $("plots"));
    this.editing = null;
    this.sent = 0;
    for (const button of document.querySelectorAll("[data-say]")) this.button(button, () => say(button.dataset.say));
    this.button($("pause"), () => this.togglePause());
    this.button($("fold"), () => this.fold(!document.body.classList.contains("folded")));
    this.button($("record"), () => say("record", { on: this.status.kept === null }));
    this.button($("defaults"), () => {
      say("open", { scene: this.scene.scene, parameters: this.scene.parameters, changes: {} });
    });
    for (const id of ["method", "integrator", "grab_acceleration"]) {
      $(id).addEventListener("change", () => { this.change(id, $(id).value); $(id).blur(); });
    }
    for (const id of ["substeps", "iterations"]) {
      $(id).addEventListener("input", () => { this.editing = id; });
      $(id).addEventListener("change", () => { this.change(id, Number($(id).value)); $(id).blur(); });
    }
    for (const id of ["stiffness", "damping", "gravity"]) {
      $(id).addEventListener("input", () => {
        this.editing = id;
        this.label(id, Number($(id).value));
        if (performance.now() - this.sent > EVERY) this.slide(id);
      });
      $(id).addEventListener("change", () => { this.slide(id); this.editing = null; });
    }
    $("rewind").addEventListener("input", () => {
      this.editing = "rewind";
      this.labelRewind(Number($("rewind").value));
      say("rewind", { frame: Number($("rewind").value) });
    });
    $("rewind").addEventListener("change", () => { this.editing = null; $("rewind").blur(); });
    new ResizeObserver(() => this.plot.draw()).observe($("plot"));
  }

  button(element, act) {
    element.addEventListener("click", () => { act(); element.blur(); }); // so that space is pause again
  }

  togglePause() {
    this.say("pause", { on: !this.status.paused });
  }

  fold(on) {
    document.body.classList.toggle("folded", on);
    $("fold").setAttribute("aria-expanded", String(!on));
  }

  change(name, value) {
    this.editing = null;
    this.sent = performance.now();
    if (name === "grab_acceleration") value = value === "exact" ? null : Number(value);
    this.say("change", { changes: { [name]: value } });
  }

  slide(id) {
    const value = Number($(id).value);
    const { editing, status } = this;
    const [x, , z] = status.settings.gravity;
    this.change(id, id === "gravity" ? [x, value, z] : value);
    this.editing = editing;
  }

  label(id, value) {
    $(id).parentElement.querySelector("output").textContent = value === null ? "–" : text[id](value);
  }

  labelRewind(frame) {
    const back = (this.status.last - frame) / this.scene.fps;
    $("rewind").parentElement.querySelector("output").textContent = back > 0 ? `−${back.toFixed(2)} s` : "now";
  }

  load(scene) {
    this.scene = scene;
    const parameters = Object.entries(scene.parameters).map(([name, value]) => `${name} ${value}`);
    $("scene").replaceChildren(scene.scene, Object.assign(document.createElement("small"), { textContent: parameters.join(", ") }));
    choices($("method"), scene.methods);
    choices($("integrator"), scene.integrators);
    document.title = `${scene.scene} · pbd-warp`;
    this.plot.load(scene.plots);
    this.editing = null;
    $("stiffness").disabled = scene.links.length === 0;
    $("row-stretch").hidden = !scene.plots.includes("max_stretch");
    $("row-residual").hidden = !scene.plots.includes("residual");
    $("colour").parentElement.hidden = scene.links.length === 0;
  }

  show(status) {
    this.status = status;
    const { settings } = status;
    const grabs = [...GRABS];
    const grab = settings.grab_acceleration === null ? "exact" : String(settings.grab_acceleration);
    if (!grabs.some(([value]) => value === grab)) grabs.push([grab, `${grab} m/s²`]);
    const shown = { ...settings, grab_acceleration: grab };
    if (this.editing !== "grab_acceleration" && $("grab_acceleration").options.length !== grabs.length) {
      $("grab_acceleration").replaceChildren(...grabs.map(([value, name]) => new Option(name, value)));
    }
    for (const id of ["method", "integrator", "substeps", "iterations", "grab_acceleration"]) {
      if (this.editing !== id && document.activeElement !== $(id)) $(id).value = shown[id];
    }
    for (const id of ["stiffness", "damping", "gravity"]) {
      if (this.editing === id) continue;
      const value = id === "gravity" ? settings.gravity[1] : settings[id];
      $(id).value = value ?? 1;
      this.label(id, value);
    }
    if (this.editing !== "rewind") {
      Object.assign($("rewind"), { min: status.first, max: status.last, disabled: status.first === status.last });
      $("rewind").value = status.frame;
      this.labelRewind(status.frame);
    }
    $("colour").querySelector("[value=tension]").disabled = !status.has_tension;
    $("pause").textContent = status.paused ? "Go on" : "Pause";
    $("record").textContent = status.kept === null ? "Record" : `Stop · ${(status.kept / this.scene.fps).toFixed(1)} s`;
    $("record").setAttribute("aria-pressed", String(status.kept !== null));
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
    if ($("cost").textContent !== status.cost) $("cost").textContent = status.cost;
    this.plots(status);
  }

  plots(status) {
    const names = this.scene.plots.concat(status.iterations === null ? [] : ["iterations"]);
    if (names.join() !== this.plotted) {
      this.plotted = names.join();
      const { rows } = this.plot;
      this.plot.load(names);
      this.plot.rows = rows;
    }
    this.plot.add(status);
    this.plot.draw();
  }
}

const short = (value, digits) => (value !== 0 && Math.abs(value) < 1e-3 ? value.toExponential(1) : String(+value.toPrecision(digits)));

export function length(metres) {
  if (metres === null) return "–";
  const [unit, factor] = metres >= 1 || metres === 0 ? ["m", 1] : metres >= 1e-3 ? ["mm", 1e3] : ["µm", 1e6];
  return `${short(factor * metres, 3)} ${unit}`;
}

function choices(select, names) {
  select.replaceChildren(...names.map((name) => new Option(name, name)));
}
