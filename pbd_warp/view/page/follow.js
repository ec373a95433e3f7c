// What walks out of the picture is framed: the camera steps back so that all that was seen fits in; what goes further
// than that is followed. Once somebody has moved the camera it stays where it is, until the view is fitted again.

import { sizeOf } from "./camera.js";

const WIDEST = 4; // how much larger than the scene at first it steps back to see
const LEAST = 0.5; // of the scene at first, that is seen of what is followed

export class Follower {
  constructor(camera) {
    this.camera = camera;
    this.on = false;
  }

  // low, high: the box that is in sight now.
  begin(low, high) {
    Object.assign(this, { on: true, low, high, size: sizeOf(low, high), middle: null });
  }

  end() {
    this.on = false;
  }

  // Once a picture, with the box of all particles: whether the camera has moved.
  step(low, high) {
    const { camera } = this;
    if (!this.on || ![...low, ...high].every(Number.isFinite)) return false;
    if (this.middle === null) {
      const wider = [this.low.map((value, k) => Math.min(value, low[k])), this.high.map((value, k) => Math.max(value, high[k]))];
      if (sizeOf(...wider) <= WIDEST * this.size) {
        [this.low, this.high] = wider;
        if (!camera.contains(low, high)) camera.follow(...wider);
        return camera.glide();
      }
    }
    const middle = low.map((value, k) => 0.5 * (value + high[k]));
    if (this.middle) camera.target = camera.target.map((value, k) => value + middle[k] - this.middle[k]);
    this.middle = middle;
    const least = LEAST * this.size / Math.max(1e-9, sizeOf(low, high));
    const grown = Math.max(1, least);
    camera.follow(...[low, high].map((corner) => corner.map((value, k) => middle[k] + grown * (value - middle[k]))));
    camera.glide();
    return true;
  }
}
