// Draws a scene with WebGL2. All numbers of particles and links are in textures, from which the vertex shaders take
// them by gl_VertexID, four vertices a square: a frame is one upload and three draws, and no instances, each of which
// costs a renderer without a GPU as much as a draw. Spheres are impostors: a square each, on which the fragment shader
// meets the ray from the eye with the sphere.

const WIDTH = 1024; // of the textures
const LINES = 81; // of the ground grid, each way
const PIECES = 20; // of each: a line that reaches behind the eye is not drawn by every renderer

const COLOURS = {
  particle: [0.93, 0.5, 0.28], fixed: [0.84, 0.88, 0.93], held: [1.0, 0.8, 0.42],
  link: [0.4, 0.6, 0.88], collider: [0.46, 0.52, 0.62], back: [0.075, 0.092, 0.122],
};

const COMMON = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform mat4 matrix;
uniform vec3 eye, forward, right, up;
uniform float scale;
`;

const SQUARES = `
uniform sampler2D positions, rows;
vec4 row(sampler2D table, int i) { return texelFetch(table, ivec2(i % ${WIDTH}, i / ${WIDTH}), 0); }
vec3 at(int i) { return row(positions, i).xyz; }
vec2 corner() { return vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1) * 2.0 - 1.0; }
`;

const LIGHT = `
vec3 lit(vec3 colour, vec3 normal, vec3 toEye) {
  vec3 light = normalize(toEye * 0.55 + up * 0.7 - right * 0.45);
  float key = max(dot(normal, light), 0.0);
  float sky = 0.5 + 0.5 * dot(normal, up);
  float gloss = pow(max(dot(normal, normalize(light + toEye)), 0.0), 40.0);
  float rim = pow(1.0 - max(dot(normal, toEye), 0.0), 3.0);
  return colour * (0.26 + 0.24 * sky + 0.64 * key) + 0.16 * gloss + 0.1 * rim * vec3(0.5, 0.65, 0.9);
}
`;

const SPHERE_VERTEX = COMMON + SQUARES + `
uniform int held;
uniform vec3 heldTint;
flat out vec3 centre, colour;
flat out float radius;
out vec3 place;
void main() {
  int i = gl_VertexID / 4;
  vec2 corner = corner();
  vec4 look = row(rows, i); // tint, radius
  centre = at(i);
  float depth = dot(centre - eye, forward);
  radius = max(look.a, 1.3 * depth / scale); // never too small to be seen
  vec3 back = eye - centre;
  float away = length(back);
  back /= away;
  vec3 side = normalize(cross(up, back));
  float reach = radius * away / sqrt(max(away * away - radius * radius, 0.01 * radius * radius)) + 0.75 * depth / scale;
  place = centre + reach * (corner.x * side + corner.y * cross(back, side));
  colour = i == held ? heldTint : look.rgb;
  gl_Position = matrix * vec4(place, 1.0);
}`;

const SPHERE_FRAGMENT = COMMON + LIGHT + `
flat in vec3 centre, colour;
flat in float radius;
in vec3 place;
uniform float leastCover;
out vec4 result;
void main() {
  vec3 ray = normalize(place - eye);
  vec3 toCentre = centre - eye;
  float along = dot(toCentre, ray);
  float miss = length(toCentre - along * ray);
  float cover = clamp((radius - miss) / max(fwidth(miss), 1e-12) + 0.5, 0.0, 1.0);
  if (cover <= leastCover) discard;
  vec3 hit = eye + (along - sqrt(max(radius * radius - miss * miss, 0.0))) * ray;
  vec4 clip = matrix * vec4(hit, 1.0);
  gl_FragDepth = 0.5 + 0.5 * clip.z / clip.w;
  result = vec4(lit(colour, normalize(hit - centre), -ray), cover);
}`;

const LINK_VERTEX = COMMON + SQUARES + `
uniform vec3 linkTint;
uniform float stretchScale; // 0: not coloured by stretch
out vec3 colour, side, front, place;
out float across;
void main() {
  vec4 link = row(rows, gl_VertexID / 4); // ends, radius, rest length
  vec2 corner = corner();
  vec3 a = at(int(link.x)), b = at(int(link.y));
  vec3 axis = b - a;
  float far = length(axis);
  vec3 centre = mix(a, b, 0.5 + 0.5 * corner.y);
  vec3 back = normalize(eye - centre);
  side = cross(axis / max(far, 1e-12), back);
  side = length(side) > 1e-6 ? normalize(side) : right;
  front = normalize(back - dot(back, axis) / max(far * far, 1e-12) * axis);
  across = corner.x;
  float radius = max(link.z, 0.75 * dot(centre - eye, forward) / scale);
  place = centre + radius * corner.x * side;
  float t = stretchScale > 0.0 && link.w > 0.0 ? clamp((far / link.w - 1.0) / stretchScale, -1.0, 1.0) : 0.0;
  vec3 base = stretchScale > 0.0 ? vec3(0.72, 0.75, 0.8) : linkTint;
  colour = mix(base, t > 0.0 ? vec3(1.0, 0.3, 0.3) : vec3(0.2, 0.72, 1.0), abs(t));
  gl_Position = matrix * vec4(place, 1.0);
}`;

const LINK_FRAGMENT = COMMON + LIGHT + `
in vec3 colour, side, front, place;
in float across;
out vec4 result;
void main() {
  vec3 normal = across * side + sqrt(max(1.0 - across * across, 0.0)) * front;
  result = vec4(lit(colour, normalize(normal), normalize(eye - place)), 1.0);
}`;

const GROUND_VERTEX = COMMON + `
uniform vec3 middle;
uniform float cell;
out vec3 world;
flat out float strength;
void main() { // first the lines along x, then those along z
  const int middleLine = ${(LINES / 2) | 0};
  int piece = gl_VertexID / 2 % ${PIECES}, line = gl_VertexID / ${2 * PIECES} % ${LINES} - middleLine;
  float along = float(middleLine) * cell * (2.0 * float(piece + (gl_VertexID & 1)) / ${PIECES}.0 - 1.0);
  float across = float(line) * cell;
  world = middle + (gl_VertexID < ${2 * PIECES * LINES} ? vec3(along, 0.0, across) : vec3(across, 0.0, along));
  strength = line % 5 == 0 ? 0.55 : 0.27;
  gl_Position = matrix * vec4(world, 1.0);
}`;

const GROUND_FRAGMENT = COMMON + `
in vec3 world;
flat in float strength;
uniform vec3 middle;
uniform float cell;
out vec4 result;
void main() {
  vec3 away = (world - middle) / (${(LINES / 4) | 0}.0 * cell);
  float grazing = smoothstep(0.0, 0.1, abs(normalize(world - eye).y)); // far lines would run into each other
  result = vec4(vec3(0.45, 0.54, 0.68), strength * exp(-dot(away, away)) * grazing);
}`;

const FLAT_VERTEX = COMMON + `
in vec3 vertex;
void main() { gl_Position = matrix * vec4(vertex, 1.0); }`;

const FLAT_FRAGMENT = COMMON + `
uniform vec4 tint;
out vec4 result;
void main() { result = tint; }`;

export class Stage {
  constructor(canvas) {
    // Smooth edges where there is a GPU; without one they would take half of all time.
    const smooth = { alpha: false, antialias: true, failIfMajorPerformanceCaveat: true };
    const gl = canvas.getContext("webgl2", smooth) ?? canvas.getContext("webgl2", { alpha: false, antialias: false });
    if (!gl) throw new Error("This browser has no WebGL2.");
    this.gl = gl;
    this.canvas = canvas;
    this.spheres = program(gl, SPHERE_VERTEX, SPHERE_FRAGMENT);
    this.links = program(gl, LINK_VERTEX, LINK_FRAGMENT);
    this.floor = program(gl, GROUND_VERTEX, GROUND_FRAGMENT);
    this.flat = program(gl, FLAT_VERTEX, FLAT_FRAGMENT);
    this.squares = gl.createBuffer();
    this.corners = gl.createBuffer();
    this.tables = [];
    gl.clearColor(...COLOURS.back, 1);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  // What stays while a scene is shown: as stage.py describes it.
  load(scene) {
    const { gl } = this;
    for (const { texture } of this.tables) gl.deleteTexture(texture);
    this.tables = [];
    this.scene = scene;
    const fixed = new Set(scene.fixed);
    this.looks = this.table(4, scene.radius.flatMap((radius, i) => [...COLOURS[fixed.has(i) ? "fixed" : "particle"], radius]));
    this.positions = this.table(3, new Array(3 * scene.radius.length).fill(0));
    this.joins = this.table(4, scene.links.flatMap((ends, k) => [...ends, scene.link_radius[k], scene.rest_length[k]]));
    this.ballLooks = this.table(4, scene.spheres.flatMap((ball) => [...COLOURS.collider, ball[3]]));
    this.balls = this.table(3, scene.spheres.flatMap((ball) => ball.slice(0, 3)));
    const most = Math.max(scene.radius.length, scene.links.length, scene.spheres.length, 1);
    const index = new Uint32Array(6 * most);
    for (let k = 0; k < most; k++) index.set([0, 1, 2, 2, 1, 3].map((corner) => 4 * k + corner), 6 * k);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.squares);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(scene.planes.flat(2)), gl.STATIC_DRAW);
    const size = Math.max(...scene.high.map((value, k) => value - scene.low[k]), 1e-3);
    this.cell = niceBelow(size / 6);
    this.ground = scene.ground;
  }

  draw(camera, x, held, stretchScale) {
    const { gl, canvas, scene } = this;
    this.fill(this.positions, x);
    this.sink(x);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const matrix = camera.matrix();
    const use = ({ program, uniform }) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(uniform("matrix"), false, matrix);
      for (const name of ["eye", "forward", "right", "up"]) gl.uniform3fv(uniform(name), camera[name]);
      gl.uniform1f(uniform("scale"), camera.scale);
      gl.uniform1i(uniform("rows"), 1);
      return uniform;
    };
    const drawSquares = (positions, rows, count) => {
      [positions, rows].forEach((table, unit) => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, table.texture);
      });
      gl.drawElements(gl.TRIANGLES, 6 * count, gl.UNSIGNED_INT, 0);
    };

    let uniform = use(this.links);
    gl.uniform3fv(uniform("linkTint"), COLOURS.link);
    gl.uniform1f(uniform("stretchScale"), stretchScale);
    drawSquares(this.positions, this.joins, scene.links.length);

    uniform = use(this.spheres);
    gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.uniform3fv(uniform("heldTint"), COLOURS.held);
    gl.uniform1f(uniform("leastCover"), gl.getContextAttributes().antialias ? 0 : 0.5);
    gl.uniform1i(uniform("held"), held);
    drawSquares(this.positions, this.looks, scene.radius.length);
    gl.uniform1i(uniform("held"), -1);
    drawSquares(this.balls, this.ballLooks, scene.spheres.length);
    gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);

    // What one sees through comes last and hides nothing.
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    uniform = use(this.floor);
    const { low, high } = scene;
    const middle = (k) => 5 * this.cell * Math.round((low[k] + high[k]) / (10 * this.cell));
    gl.uniform3f(uniform("middle"), middle(0), this.ground, middle(2));
    gl.uniform1f(uniform("cell"), this.cell);
    gl.drawArrays(gl.LINES, 0, 4 * PIECES * LINES);
    uniform = use(this.flat);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    let first = 0;
    for (const { length } of scene.planes) {
      gl.uniform4f(uniform("tint"), 0.5, 0.6, 0.75, 0.1);
      gl.drawArrays(gl.TRIANGLE_FAN, first, length);
      gl.uniform4f(uniform("tint"), 0.62, 0.7, 0.82, 0.5);
      gl.drawArrays(gl.LINE_LOOP, first, length);
      first += length;
    }
    gl.disableVertexAttribArray(0);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  // The grid is below the motion: where that goes deeper than expected, the grid goes with it.
  sink(x) {
    const { radius, low, high } = this.scene;
    let lowest = Infinity;
    for (let i = 0; i < radius.length; i++) lowest = Math.min(lowest, x[3 * i + 1] - radius[i]);
    const gap = 0.02 * Math.max(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
    if (lowest - gap < this.ground) this.ground = lowest - gap;
  }

  // Rows of `width` numbers as a texture.
  table(width, values) {
    const { gl } = this;
    const lines = Math.max(1, Math.ceil(values.length / width / WIDTH));
    const table = { width, lines, texture: gl.createTexture(), texels: new Float32Array(width * WIDTH * lines) };
    gl.bindTexture(gl.TEXTURE_2D, table.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, width === 3 ? gl.RGB32F : gl.RGBA32F, WIDTH, lines);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    this.tables.push(table);
    this.fill(table, values);
    return table;
  }

  fill({ width, lines, texture, texels }, values) {
    const { gl } = this;
    texels.set(values);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDTH, lines, width === 3 ? gl.RGB : gl.RGBA, gl.FLOAT, texels);
  }
}

// The largest of ..., 0.1, 0.2, 0.5, 1, 2, ... that is not above a value.
function niceBelow(value) {
  const ten = 10 ** Math.floor(Math.log10(value));
  return ten * [5, 2, 1].find((step) => step * ten <= value * (1 + 1e-9));
}

function program(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.bindAttribLocation(program, 0, "vertex");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  const found = new Map();
  const uniform = (name) => {
    if (!found.has(name)) found.set(name, gl.getUniformLocation(program, name));
    return found.get(name);
  };
  return { program, uniform };
}
