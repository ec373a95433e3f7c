// Draws a scene with WebGL2. All numbers of particles and links are in textures, from which the vertex shaders take
// them by gl_VertexID, four vertices a square: a frame is one upload and three draws, and no instances, each of which
// costs a renderer without a GPU as much as a draw. Spheres are impostors: a square each, on which the fragment shader
// meets the ray from the eye with the sphere.

import {
  FLAT_FRAGMENT, FLAT_VERTEX, GROUND_FRAGMENT, GROUND_VERTEX, LINES, LINK_FRAGMENT, LINK_VERTEX, PIECES, SPHERE_FRAGMENT,
  SOLID_FRAGMENT, SOLID_VERTEX, SPHERE_VERTEX, WIDTH,
} from "./shaders.js";

// Colours for the two schemes of the page.
export const THEMES = {
  dark: {
    particle: [0.93, 0.5, 0.28], fixed: [0.84, 0.88, 0.93], held: [1.0, 0.8, 0.42], link: [0.4, 0.6, 0.88],
    collider: [0.46, 0.52, 0.62], wall: [0.17, 0.2, 0.26], edge: [0.42, 0.49, 0.6], grid: [0.45, 0.54, 0.68],
    slack: [0.2, 0.72, 1.0], rest: [0.72, 0.75, 0.8], taut: [1.0, 0.3, 0.3], back: [0.075, 0.092, 0.122],
  },
  light: {
    particle: [0.9, 0.42, 0.18], fixed: [0.3, 0.34, 0.4], held: [0.98, 0.68, 0.1], link: [0.24, 0.46, 0.78],
    collider: [0.62, 0.67, 0.75], wall: [0.83, 0.85, 0.89], edge: [0.5, 0.55, 0.63], grid: [0.45, 0.5, 0.58],
    slack: [0.0, 0.5, 0.9], rest: [0.62, 0.64, 0.68], taut: [0.86, 0.1, 0.1], back: [0.965, 0.97, 0.98],
  },
};

export class Drawing {
  constructor(canvas, colours) {
    // Smooth edges where there is a GPU; without one they would take most of the time.
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: !bySoftware() });
    if (!gl) throw new Error("This browser has no WebGL2.");
    this.gl = gl;
    this.canvas = canvas;
    this.spheres = program(gl, SPHERE_VERTEX, SPHERE_FRAGMENT);
    this.links = program(gl, LINK_VERTEX, LINK_FRAGMENT);
    this.floor = program(gl, GROUND_VERTEX, GROUND_FRAGMENT);
    this.flat = program(gl, FLAT_VERTEX, FLAT_FRAGMENT);
    this.solid = program(gl, SOLID_VERTEX, SOLID_FRAGMENT);
    this.facets = gl.createBuffer();
    this.squares = gl.createBuffer();
    this.corners = gl.createBuffer();
    this.tables = [];
    this.colours = colours;
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  // Other colours, one of THEMES.
  paint(colours) {
    this.colours = colours;
    if (this.scene) this.load(this.scene);
  }

  // What stays while a scene is shown: as surroundings.py describes it.
  load(scene) {
    const { gl, colours } = this;
    for (const { texture } of this.tables) gl.deleteTexture(texture);
    this.tables = [];
    this.scene = scene;
    const fixed = new Set(scene.fixed);
    this.looks = this.table(4, scene.radius.flatMap((radius, i) => [...colours[fixed.has(i) ? "fixed" : "particle"], radius]));
    this.positions = this.table(3, new Array(3 * scene.radius.length).fill(0));
    this.joins = this.table(4, scene.links.flatMap((ends, k) => [...ends, scene.link_radius[k], scene.rest_length[k]]));
    this.pulls = this.table(1, new Array(scene.links.length).fill(0));
    this.ballLooks = this.table(4, scene.spheres.flatMap((ball) => [...colours.collider, ball[3]]));
    this.balls = this.table(3, scene.spheres.flatMap((ball) => ball.slice(0, 3)));
    const most = Math.max(scene.radius.length, scene.links.length, scene.spheres.length, 1);
    const index = new Uint32Array(6 * most);
    for (let k = 0; k < most; k++) index.set([0, 1, 2, 2, 1, 3].map((corner) => 4 * k + corner), 6 * k);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.squares);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([...scene.walls, ...scene.planes].flat(2)), gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.facets);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(scene.solids.flatMap(facets)), gl.STATIC_DRAW);
    const size = Math.max(...scene.high.map((value, k) => value - scene.low[k]), 1e-3);
    this.cell = niceBelow(size / 6);
    this.clear();
  }

  clear() {
    const { gl } = this;
    gl.clearColor(...this.colours.back, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  // x: positions [m]; held: a particle to be highlighted, or -1; colouring: { scale, tension }, what is drawn in full
  // colour, of the links' stretch or of their tension [N], where there is one; null: links have a colour of their own.
  // time: since the start [s], for solids that move.
  draw(camera, x, held = -1, colouring = null, time = 0) {
    const { gl, canvas, scene, colours } = this;
    this.fill(this.positions, x);
    if (colouring?.tension) this.fill(this.pulls, colouring.tension);
    gl.viewport(0, 0, canvas.width, canvas.height);
    this.clear();
    gl.enable(gl.DEPTH_TEST);
    const matrix = camera.matrix();
    const use = ({ program, uniform }) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(uniform("matrix"), false, matrix);
      for (const name of ["eye", "forward", "right", "up"]) gl.uniform3fv(uniform(name), camera[name]);
      gl.uniform1f(uniform("scale"), camera.scale);
      gl.uniform1i(uniform("ortho"), camera.ortho ? 1 : 0);
      gl.uniform1i(uniform("rows"), 1);
      return uniform;
    };
    const drawSquares = (count, ...tables) => {
      tables.forEach((table, unit) => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, table.texture);
      });
      gl.drawElements(gl.TRIANGLES, 6 * count, gl.UNSIGNED_INT, 0);
    };

    const drawPolygons = (polygons, first, tint, edge) => {
      for (const { length } of polygons) {
        gl.uniform4f(uniform("tint"), ...tint);
        gl.drawArrays(gl.TRIANGLE_FAN, first, length);
        gl.uniform4f(uniform("tint"), ...edge);
        gl.drawArrays(gl.LINE_LOOP, first, length);
        first += length;
      }
    };
    const corners = () => {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
      gl.enableVertexAttribArray(0);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    };

    let uniform = use(this.flat);
    corners();
    drawPolygons(scene.walls, 0, [...colours.wall, 1], [...colours.wall, 1]);
    gl.disableVertexAttribArray(0);

    if (scene.solids.length) {
      uniform = use(this.solid);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.facets);
      for (const [place, name] of [[0, 0], [1, 12]]) {
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 24, name);
      }
      gl.uniform3fv(uniform("tint"), colours.collider);
      let first = 0;
      for (const { centre, velocity, spin, triangles } of scene.solids) {
        gl.uniform3fv(uniform("centre"), centre.map((value, k) => value + time * velocity[k]));
        gl.uniform3fv(uniform("turn"), spin.map((value) => time * value));
        gl.drawArrays(gl.TRIANGLES, first, 3 * triangles.length);
        first += 3 * triangles.length;
      }
      gl.disableVertexAttribArray(0);
      gl.disableVertexAttribArray(1);
    }

    uniform = use(this.links);
    gl.uniform3fv(uniform("linkTint"), colours.link);
    gl.uniform3fv(uniform("slackTint"), colours.slack);
    gl.uniform3fv(uniform("restTint"), colours.rest);
    gl.uniform3fv(uniform("tautTint"), colours.taut);
    gl.uniform1f(uniform("colourScale"), colouring?.scale ?? 0);
    gl.uniform1i(uniform("byTension"), colouring?.tension ? 1 : 0);
    gl.uniform1i(uniform("pulls"), 2);
    drawSquares(scene.links.length, this.positions, this.joins, this.pulls);

    uniform = use(this.spheres);
    gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.uniform3fv(uniform("heldTint"), colours.held);
    gl.uniform1f(uniform("leastCover"), gl.getContextAttributes().antialias ? 0 : 0.5);
    gl.uniform1i(uniform("held"), held);
    drawSquares(scene.radius.length, this.positions, this.looks);
    gl.uniform1i(uniform("held"), -1);
    drawSquares(scene.spheres.length, this.balls, this.ballLooks);
    gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);

    // What one sees through comes last and hides nothing.
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    if (scene.ground !== null) {
      uniform = use(this.floor);
      const middle = (k) => 5 * this.cell * Math.round((scene.low[k] + scene.high[k]) / (10 * this.cell));
      gl.uniform3f(uniform("middle"), middle(0), scene.ground, middle(2));
      gl.uniform3fv(uniform("tint"), colours.grid);
      gl.uniform1f(uniform("cell"), this.cell);
      gl.drawArrays(gl.LINES, 0, 4 * PIECES * LINES);
    }
    uniform = use(this.flat);
    corners();
    drawPolygons(scene.planes, scene.walls.flat().length, [...colours.edge, 0.1], [...colours.edge, 0.6]);
    gl.disableVertexAttribArray(0);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  // Rows of `width` numbers as a texture.
  table(width, values) {
    const { gl } = this;
    const lines = Math.max(1, Math.ceil(values.length / width / WIDTH));
    const table = { width, lines, texture: gl.createTexture(), texels: new Float32Array(width * WIDTH * lines) };
    gl.bindTexture(gl.TEXTURE_2D, table.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, { 1: gl.R32F, 3: gl.RGB32F, 4: gl.RGBA32F }[width], WIDTH, lines);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    this.tables.push(table);
    this.fill(table, values);
    return table;
  }

  fill({ width, lines, texture, texels }, values) {
    const { gl } = this;
    texels.set(values);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    const format = { 1: gl.RED, 3: gl.RGB, 4: gl.RGBA }[width];
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDTH, lines, format, gl.FLOAT, texels);
  }
}

// Whether there is no GPU: some say so of themselves, others by their name.
function bySoftware() {
  const probe = document.createElement("canvas").getContext("webgl2", { failIfMajorPerformanceCaveat: true });
  if (!probe) return true;
  const info = probe.getExtension("WEBGL_debug_renderer_info");
  const name = probe.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : probe.RENDERER);
  probe.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

// The corners of a solid's triangles, each with the normal of its triangle: x, y, z, nx, ny, nz.
function facets({ points, triangles }) {
  return triangles.flatMap((corners) => {
    const [a, b, c] = corners.map((corner) => points[corner]);
    const [u, v] = [b, c].map((to) => to.map((value, k) => value - a[k]));
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const size = Math.hypot(...n) || 1;
    return [a, b, c].flatMap((corner) => [...corner, ...n.map((value) => value / size)]);
  });
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
  gl.bindAttribLocation(program, 1, "normal");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  const found = new Map();
  const uniform = (name) => {
    if (!found.has(name)) found.set(name, gl.getUniformLocation(program, name));
    return found.get(name);
  };
  return { program, uniform };
}
