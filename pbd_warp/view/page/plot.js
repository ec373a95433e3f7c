// A plot of figures over simulated time: axes with units, and a legend in which one chooses what is shown.

const SHOWN = 20; // s of simulated time
const PLOTS = { // name in the status: what it is called, unit, factor, colour's number
  energy: ["energy", "J", 1, 0],
  kinetic: ["kinetic", "J", 1, 1],
  potential: ["potential", "J", 1, 2],
  max_stretch: ["stretch", "%", 100, 3],
  residual: ["residual", "mm", 1e3, 4],
  iterations: ["iterations", "", 1, 5],
  ms: ["time a frame", "ms", 1, 6],
};
const GROUPS = [["energy", "kinetic", "potential"], ["max_stretch"], ["residual"], ["iterations"], ["ms"]];

export class Plot {
  constructor(canvas, legend) {
    this.canvas = canvas;
    this.legend = legend;
    this.chosen = new Set(["energy", "kinetic", "potential"]);
    this.clear();
  }

  clear() {
    this.rows = [];
  }

  // names: of the figures that there are.
  load(names) {
    this.clear();
    this.names = Object.keys(PLOTS).filter((name) => names.includes(name));
    if (![...this.chosen].some((name) => this.names.includes(name))) this.chosen.add(this.names[0]);
    this.legend.replaceChildren(...this.names.map((name) => {
      const label = document.createElement("label");
      const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: this.chosen.has(name), value: name });
      const colour = document.createElement("i");
      colour.dataset.colour = PLOTS[name][3];
      label.append(box, colour, PLOTS[name][0]);
      box.addEventListener("change", () => this.choose(name, box.checked));
      return label;
    }));
  }

  // One plot has one axis: figures of another unit take the place of those that are shown.
  choose(name, on) {
    const group = GROUPS.find((names) => names.includes(name));
    this.chosen = new Set([...this.chosen].filter((other) => group.includes(other)));
    if (on) this.chosen.add(name);
    else this.chosen.delete(name);
    for (const box of this.legend.querySelectorAll("input")) box.checked = this.chosen.has(box.value);
    this.draw();
  }

  add(status) {
    const last = this.rows.at(-1);
    if (last && status.time < last.time) this.rows = this.rows.filter((row) => row.time < status.time);
    if (last?.time !== status.time) this.rows.push(status);
    while (this.rows[0].time < status.time - SHOWN) this.rows.shift();
  }

  draw() {
    const { canvas, rows } = this;
    const ratio = window.devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return; // folded
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const style = getComputedStyle(canvas);
    pen.font = `11px ${style.fontFamily}`;
    pen.fillStyle = style.color;
    const names = (this.names ?? []).filter((name) => this.chosen.has(name));
    const values = names.map((name) => rows.map((row) => (row[name] === null ? NaN : PLOTS[name][2] * row[name])));
    const finite = values.flat().filter(Number.isFinite);
    if (!finite.length) {
      pen.textAlign = "center";
      pen.fillText(names.length ? "no values yet" : "choose below what is shown", width / 2, height / 2);
      return;
    }
    const y = axis(Math.min(...finite), Math.max(...finite), names.includes("iterations"));
    const end = Math.max(rows.at(-1).time, 2);
    const start = Math.max(0, end - SHOWN);
    const labels = y.ticks.map((tick) => plain(tick, y.step));
    const left = 8 + Math.max(...labels.map((text) => pen.measureText(text).width));
    const [top, bottom, right] = [24, height - 16, width - 6];
    const px = (time) => left + (right - left) * (time - start) / (end - start);
    const py = (value) => bottom - (bottom - top) * (value - y.low) / (y.high - y.low);
    pen.fillText(unit(names[0]), 0, 10);
    pen.strokeStyle = style.borderColor;
    pen.lineWidth = 1;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    y.ticks.forEach((tick, k) => {
      line(pen, [[left, Math.round(py(tick)) + 0.5], [right, Math.round(py(tick)) + 0.5]]);
      pen.fillText(labels[k], left - 5, py(tick));
    });
    pen.textBaseline = "alphabetic";
    const x = axis(start, end);
    for (const tick of x.ticks.filter((tick) => tick >= start && tick <= end)) {
      pen.textAlign = px(tick) > right - 12 ? "right" : "center";
      pen.fillText(`${plain(tick, x.step)} s`, px(tick), height - 2);
    }
    pen.lineWidth = 1.75;
    pen.lineJoin = "round";
    names.forEach((name, k) => {
      pen.strokeStyle = style.getPropertyValue(`--plot-${PLOTS[name][3]}`);
      line(pen, rows.map((row, i) => [px(row.time), py(values[k][i])]));
    });
  }
}

const unit = (name) => (PLOTS[name][1] ? `${name.startsWith("m") || name === "residual" ? `${PLOTS[name][0]} ` : ""}[${PLOTS[name][1]}]` : PLOTS[name][0]);

function line(pen, points) {
  pen.beginPath();
  let drawing = false; // what is not finite leaves a gap
  for (const [x, y] of points) {
    if (!Number.isFinite(y)) drawing = false;
    else if (drawing) pen.lineTo(x, y);
    else pen.moveTo(x, y), drawing = true;
  }
  pen.stroke();
}

// A range that holds both values, with ticks at round numbers.
export function axis(low, high, whole = false) {
  const least = Math.max(1e-9 * Math.max(Math.abs(low), Math.abs(high)), 1e-12); // what is constant is a straight line
  const span = Math.max(high - low, least);
  const ten = 10 ** Math.floor(Math.log10(span / 3));
  let step = ten * [1, 2, 5, 10].find((factor) => factor * ten >= span / 3 * (1 - 1e-9));
  if (whole) step = Math.max(1, Math.round(step));
  const first = Math.floor(low / step * (1 + 1e-12)), last = Math.max(first + 1, Math.ceil(high / step * (1 - 1e-12)));
  return { low: first * step, high: last * step, step, ticks: Array.from({ length: last - first + 1 }, (_, k) => (first + k) * step) };
}

function plain(value, step) {
  if (value === 0) return "0";
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return digits > 5 || Math.abs(value) >= 1e6 ? value.toExponential(1) : value.toFixed(digits);
}
