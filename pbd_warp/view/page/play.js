// Frames arrive when they like; they are shown at an even rate, between the last ones that are there.

const KEPT = 6;
const LAG = 1.25; // of the mean gap between frames: how far what is shown is behind the newest
const PULL = 0.08; // part of the error of the lag that each picture takes away
const LOST = 12; // gaps: whoever is further behind jumps

// number: of a frame; x: its positions. Times are in seconds, of any one clock.
export class Playhead {
  constructor() {
    this.clear();
  }

  clear() {
    this.frames = [];
    this.at = 0; // the number that is shown, fractions between two frames
    this.rate = 0; // frames a second
    this.gap = 1; // frames from one to the next
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
    } else {
      const rate = (number - last.number) / Math.max(1e-3, time - last.time);
      this.rate += (this.rate ? 0.1 : 1) * (Math.min(rate, 10 * (this.rate || rate)) - this.rate);
      this.gap += 0.1 * (number - last.number - this.gap);
    }
    this.frames.push({ number, x, time });
    if (this.frames.length > KEPT) this.frames.shift();
  }

  // Positions at a time; `still`: of the newest frame. With the number of the frame that one sees in them.
  show(time, still = false) {
    const newest = this.newest;
    if (!newest) return null;
    const passed = this.now === null ? 0 : Math.min(0.1, time - this.now);
    this.now = time;
    const wanted = newest.number - LAG * this.gap;
    if (still || this.at < newest.number - LOST * this.gap) this.at = newest.number;
    // Faster or slower by what it is behind or ahead, but never back.
    else this.at += Math.max(0, passed * this.rate + PULL * (wanted + passed * this.rate - this.at));
    this.at = Math.min(this.at, newest.number);
    const next = this.frames.find((frame) => frame.number >= this.at);
    const before = this.frames.findLast((frame) => frame.number <= this.at) ?? next;
    if (before === next) return { x: next.x, number: next.number };
    const part = (this.at - before.number) / (next.number - before.number);
    const x = new Float32Array(next.x.length);
    for (let k = 0; k < x.length; k++) x[k] = before.x[k] + part * (next.x[k] - before.x[k]);
    return { x, number: part < 0.5 ? before.number : next.number };
  }
}
