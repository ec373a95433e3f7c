// An orbiting camera, perspective or orthographic: from the world to the pixels of the canvas and back.

const FIELD_OF_VIEW = 0.7; // vertical [rad]
const MARGIN = 1.2; // how much more than the scene is seen
const EDGE = 0.94; // what is beyond this part of the way to the edge walks out
const REACH = 14; // px, that a click may miss a particle by
const TAN = Math.tan(FIELD_OF_VIEW / 2);

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];

// [low, high] of positions, with a radius each.
export function boxOf(x, radius) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < radius.length; i++) {
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], x[3 * i + k] - radius[i]);
      high[k] = Math.max(high[k], x[3 * i + k] + radius[i]);
    }
  }
  return [low, high];
}

export const sizeOf = (low, high) => Math.hypot(...low.map((value, k) => high[k] - value));

export class Camera {
  constructor() {
    this.target = [0, 0, 0];
    this.distance = 3; // of an orthographic one: what it shows is as large as from there
    this.size = 1; // of the scene [m]
    this.yaw = this.pitch = 0;
    this.ortho = false;
    this.goal = null; // { target, distance } that it glides to
    this.width = this.height = 1;
    this.update();
  }

  // Face-on and orthographic to a scene that lies in a plane, from above and aside to any other.
  frame(low, high, axis) {
    this.ortho = axis !== null;
    [this.yaw, this.pitch] = axis === null ? [0.6, 0.35] : [[Math.PI / 2, 0], [0, Math.PI / 2], [0, 0]][axis];
    this.update();
    this.fit(low, high);
  }

  // Show a box from where it looks now.
  fit(low, high) {
    Object.assign(this, this.fitting(low, high));
    this.goal = null;
    this.size = Math.max(1e-3, Math.hypot(...low.map((value, k) => high[k] - value)));
    this.update();
  }

  // From where a box is seen as a whole.
  fitting(low, high) {
    const target = low.map((value, k) => 0.5 * (value + high[k]));
    let distance = 1e-3;
    for (let corner = 0; corner < 8; corner++) {
      const away = low.map((value, k) => (corner >> k & 1 ? high[k] : value) - target[k]);
      const across = Math.max(Math.abs(dot(away, this.right)) * this.height / this.width, Math.abs(dot(away, this.up)));
      distance = Math.max(distance, MARGIN * across / TAN - (this.ortho ? 0 : dot(away, this.forward)));
    }
    return { target, distance };
  }

  // Glide to where a box is seen; `glide` makes the next bit of the way.
  follow(low, high) {
    this.goal = this.fitting(low, high);
  }

  glide() {
    if (!this.goal) return false;
    const { target, distance } = this.goal;
    this.target = this.target.map((value, k) => value + 0.12 * (target[k] - value));
    this.distance += 0.12 * (distance - this.distance);
    const left = Math.hypot(...target.map((value, k) => value - this.target[k])) + Math.abs(distance - this.distance);
    if (left < 1e-3 * this.distance) this.goal = null;
    this.update();
    return true;
  }

  // Whether all of a box is on the canvas, a little away from its edge.
  contains(low, high) {
    for (let corner = 0; corner < 8; corner++) {
      const [x, y, depth] = this.project([0, 1, 2].map((k) => (corner >> k & 1 ? high[k] : low[k])), 0);
      if (!(depth > 0) || Math.abs(2 * x / this.width - 1) > EDGE || Math.abs(2 * y / this.height - 1) > EDGE) return false;
    }
    return true;
  }

  turn(dx, dy) {
    this.yaw -= 0.006 * dx;
    this.pitch = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.pitch + 0.006 * dy));
    this.moved();
  }

  pan(dx, dy) {
    const metres = this.distance / this.pixels;
    this.target = add(add(this.target, this.right, -dx * metres), this.up, dy * metres);
    this.moved();
  }

  zoom(factor) {
    this.distance = Math.min(300 * this.size, Math.max(0.01 * this.size, this.distance * factor));
    this.moved();
  }

  moved() {
    this.goal = null;
    this.update();
  }

  resize(width, height) {
    this.width = Math.max(1, width);
    this.height = Math.max(1, height);
    this.update();
  }

  update() {
    const out = [Math.sin(this.yaw) * Math.cos(this.pitch), Math.sin(this.pitch), Math.cos(this.yaw) * Math.cos(this.pitch)];
    this.forward = out.map((value) => -value);
    this.right = [Math.cos(this.yaw), 0, -Math.sin(this.yaw)];
    this.up = cross(this.right, this.forward);
    this.pixels = 0.5 * this.height / TAN; // of a metre, a metre away
    // Orthographic: px of a metre; otherwise of one a metre away.
    this.scale = this.ortho ? this.pixels / this.distance : this.pixels;
    const reach = (this.ortho ? 50 : 1000) * Math.max(this.size, this.distance);
    this.near = this.ortho ? 0 : 1e-3 * this.distance;
    this.far = this.ortho ? 2 * reach : reach;
    this.eye = add(this.target, out, this.ortho ? reach : this.distance);
  }

  // Metres that a pixel shows at a depth.
  metres(depth) {
    return this.ortho ? 1 / this.scale : depth / this.scale;
  }

  // Column by column, for WebGL.
  matrix() {
    const { right, up, forward, eye, near, far, ortho } = this;
    const y = ortho ? 2 * this.scale / this.height : 1 / TAN;
    const x = y * this.height / this.width;
    const z = ortho ? 2 / far : (far + near) / (far - near);
    const shift = ortho ? -1 : -2 * far * near / (far - near);
    const rows = [
      [...right.map((value) => x * value), -x * dot(right, eye)],
      [...up.map((value) => y * value), -y * dot(up, eye)],
      [...forward.map((value) => z * value), shift - z * dot(forward, eye)],
      ortho ? [0, 0, 0, 1] : [...forward, -dot(forward, eye)],
    ];
    return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
  }

  // Of particle i [x, y, depth]: px from the upper left corner, m along the view.
  project(x, i) {
    const away = [x[3 * i] - this.eye[0], x[3 * i + 1] - this.eye[1], x[3 * i + 2] - this.eye[2]];
    const depth = dot(away, this.forward);
    const metres = this.metres(depth);
    return [0.5 * this.width + dot(away, this.right) / metres, 0.5 * this.height - dot(away, this.up) / metres, depth];
  }

  // The point at a place on the canvas that lies in the plane through another one that faces the camera; null where
  // that is behind the camera.
  unproject(at, through) {
    const depth = dot(add(through, this.eye, -1), this.forward);
    if (!(depth > 0)) return null;
    const metres = this.metres(depth);
    const across = add(add(this.eye, this.forward, depth), this.right, (at[0] - 0.5 * this.width) * metres);
    return add(across, this.up, (0.5 * this.height - at[1]) * metres);
  }

  // The particle nearest to a place on the canvas, -1 where none is within 14 px. The distance is to the disc that
  // shows it, so 0 on it; of several at the same distance the one whose surface is in front there.
  nearest(x, radius, at) {
    let best = -1, bestGap = REACH, bestFront = Infinity;
    for (let i = 0; i < radius.length; i++) {
      const [px, py, depth] = this.project(x, i);
      if (!(depth > 0)) continue;
      const metres = this.metres(depth);
      const away = Math.hypot(px - at[0], py - at[1]);
      const gap = Math.max(0, away - radius[i] / metres);
      if (gap > bestGap + 1e-3) continue;
      const front = depth - Math.sqrt(Math.max(0, radius[i] ** 2 - (away * metres) ** 2));
      if (gap < bestGap - 1e-3 || best < 0 || front < bestFront) [best, bestGap, bestFront] = [i, gap, front];
    }
    return best;
  }
}
