// Frames arrive when they like; they are shown at an even rate, between the last ones that are there.

const KEPT = 8; // frames to show from
const RATED = 60; // arrivals that the rate is taken from
const PAUSE = 0.5; // s without a frame, after which the rate begins anew
const CORRECTION = 0.05; // part of what it is ahead or behind, that each picture takes away
const LOST = 12; // gaps: whoever is further behind jumps

// number: of a frame; x: its positions, and what else goes from frame to frame as they do. Times are in seconds, of any one clock.
export class Playhead {
  constructor() {
    this.clear();
  }

  clear() {
    this.frames = []; // { number, x, time }
    this.arrivals = []; // { number, time }
    this.at = 0; // the number that is shown, fractions between two frames
    this.rate = 0; // frames a second
    this.gap = 1; // from one frame to the next
    this.late = 0; // by how much frames come earlier or later than the rate has it, in frames
    this.now = null;
  }

  get newest() {
    return this.frames.at(-1) ?? null;
  }

  // Whether what is shown stays the same until another frame arrives.
  get atEnd() {
    return this.newest === null || this.at >= this.newest.number;
  }

  add(number, x, time) {
    const last = this.newest;
    if (last && number === last.number) {
      last.x = x;
      return;
    }
    if (!last || number < last.number) { // another beginning
      this.clear();
      this.at = number;
    } else if (time - last.time > PAUSE) {
      this.arrivals = [];
    } else {
      const apart = number - last.number;
      if (this.arrivals.length > 1) {
        this.late += 0.1 * (Math.abs((time - last.time) * this.rate - apart) - this.late);
        this.gap += 0.1 * (apart - this.gap);
      }
      const [first] = this.arrivals;
      this.rate = (number - first.number) / Math.max(1e-3, time - first.time);
    }
    this.arrivals.push({ number, time });
    if (this.arrivals.length > RATED) this.arrivals.shift();
    this.frames.push({ number, x, time });
    if (this.frames.length > KEPT) this.frames.shift();
  }

  // Positions at a time; `still`: of the newest frame. With the number of the frame that one sees in them.
  show(time, still = false) {
    const { newest, gap, rate } = this;
    if (!newest) return null;
    const passed = this.now === null ? 0 : Math.min(0.1, time - this.now);
    this.now = time;
    if (still || this.at < newest.number - LOST * gap) {
      this.at = newest.number;
    } else {
      // A frame and a little behind where the newest is by now, so that the next one is mostly there in time.
      const since = Math.min(rate * (time - newest.time), 2 * gap);
      const wanted = newest.number + since - 1.15 * gap - 2 * this.late;
      const step = passed * rate;
      this.at += Math.max(0, step + CORRECTION * (wanted - this.at - step));
      this.at = Math.min(this.at, newest.number);
    }
    const next = this.frames.find((frame) => frame.number >= this.at);
    const before = this.frames.findLast((frame) => frame.number <= this.at) ?? next;
    if (before === next) return { x: next.x, number: next.number, at: next.number };
    const part = (this.at - before.number) / (next.number - before.number);
    const x = new Float32Array(Math.min(before.x.length, next.x.length));
    for (let k = 0; k < x.length; k++) x[k] = before.x[k] + part * (next.x[k] - before.x[k]);
    return { x, number: part < 0.5 ? before.number : next.number, at: this.at };
  }
}
