// An orbiting camera. What a click or a move means is decided by the server, from `describe()`; `nearest` only shows
// beforehand what a click would select, by the same rule (pbd_warp/camera.py).

const FIELD_OF_VIEW = 0.7; // vertical [rad]
const MARGIN = 1.2; // how much more than the scene is seen
const REACH = 14; // px

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];

export class Camera {
  constructor() {
    this.target = [0, 0, 0];
    this.distance = 3;
    this.yaw = this.pitch = 0;
    this.width = this.height = 1;
    this.update();
  }

  // Face-on to a scene that lies in a plane, from above and aside to any other.
  frame(low, high, axis) {
    [this.yaw, this.pitch] = axis === null ? [0.6, 0.35] : [[Math.PI / 2, 0], [0, Math.PI / 2], [0, 0]][axis];
    this.target = low.map((value, k) => 0.5 * (value + high[k]));
    this.distance = 1;
    this.update();
    const tan = Math.tan(FIELD_OF_VIEW / 2);
    let distance = 1e-3;
    for (let corner = 0; corner < 8; corner++) {
      const away = low.map((value, k) => (corner >> k & 1 ? high[k] : value) - this.target[k]);
      const across = Math.max(Math.abs(dot(away, this.right)) * this.height / this.width, Math.abs(dot(away, this.up)));
      distance = Math.max(distance, MARGIN * across / tan - dot(away, this.forward));
    }
    this.distance = distance;
    this.near = 1e-3 * distance;
    this.far = 1e3 * distance;
    this.update();
  }

  turn(dx, dy) {
    this.yaw -= 0.006 * dx;
    this.pitch = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.pitch + 0.006 * dy));
    this.update();
  }

  pan(dx, dy) {
    const metres = this.distance / this.scale;
    this.target = add(add(this.target, this.right, -dx * metres), this.up, dy * metres);
    this.update();
  }

  zoom(factor) {
    this.distance = Math.min(0.3 * this.far, Math.max(10 * this.near, this.distance * factor));
    this.update();
  }

  resize(width, height) {
    this.width = Math.max(1, width);
    this.height = Math.max(1, height);
    this.update();
  }

  update() {
    const out = [Math.sin(this.yaw) * Math.cos(this.pitch), Math.sin(this.pitch), Math.cos(this.yaw) * Math.cos(this.pitch)];
    this.eye = add(this.target, out, this.distance);
    this.forward = out.map((value) => -value);
    this.right = [Math.cos(this.yaw), 0, -Math.sin(this.yaw)];
    this.up = cross(this.right, this.forward);
    this.scale = 0.5 * this.height / Math.tan(FIELD_OF_VIEW / 2); // px of a metre, a metre away
  }

  // Column by column, for WebGL.
  matrix() {
    const { right, up, forward, eye, near, far } = this;
    const y = 1 / Math.tan(FIELD_OF_VIEW / 2);
    const x = y * this.height / this.width;
    const z = (far + near) / (far - near);
    const shift = -2 * far * near / (far - near);
    const rows = [
      [...right.map((value) => x * value), -x * dot(right, eye)],
      [...up.map((value) => y * value), -y * dot(up, eye)],
      [...forward.map((value) => z * value), shift - z * dot(forward, eye)],
      [...forward, -dot(forward, eye)],
    ];
    return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
  }

  // [x, y, depth]: px from the upper left corner, m along the view.
  project(x, i) {
    const away = [x[3 * i] - this.eye[0], x[3 * i + 1] - this.eye[1], x[3 * i + 2] - this.eye[2]];
    const depth = dot(away, this.forward);
    const scale = this.scale / depth;
    return [0.5 * this.width + scale * dot(away, this.right), 0.5 * this.height - scale * dot(away, this.up), depth];
  }

  nearest(x, radius, at) {
    let best = -1, bestGap = REACH, bestFront = Infinity;
    for (let i = 0; i < radius.length; i++) {
      const [px, py, depth] = this.project(x, i);
      if (!(depth > 0)) continue;
      const metres = depth / this.scale;
      const away = Math.hypot(px - at[0], py - at[1]);
      const gap = Math.max(0, away - radius[i] / metres);
      if (gap > bestGap + 1e-3) continue;
      const front = depth - Math.sqrt(Math.max(0, radius[i] ** 2 - (away * metres) ** 2));
      if (gap < bestGap - 1e-3 || best < 0 || front < bestFront) [best, bestGap, bestFront] = [i, gap, front];
    }
    return best;
  }

  describe() {
    return {
      eye: this.eye, forward: this.forward, up: this.up, field_of_view: FIELD_OF_VIEW, size: [this.width, this.height],
    };
  }
}
