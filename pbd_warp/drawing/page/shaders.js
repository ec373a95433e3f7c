// GLSL of draw.js.

export const WIDTH = 1024; // of the textures
export const LINES = 81; // of the ground grid, each way
export const PIECES = 20; // of each: a line that reaches behind the eye is not drawn by every renderer

const COMMON = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform mat4 matrix;
uniform vec3 eye, forward, right, up;
uniform float scale; // px of a metre: orthographic, or a metre away
uniform bool ortho;
vec3 toEye(vec3 p) { return ortho ? -forward : normalize(eye - p); }
float pixel(vec3 p) { return (ortho ? 1.0 : dot(p - eye, forward)) / scale; } // [m]
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
  return colour * (0.36 + 0.24 * sky + 0.52 * key) + 0.14 * gloss + 0.1 * rim * vec3(0.5, 0.65, 0.9);
}
`;

export const SPHERE_VERTEX = COMMON + SQUARES + `
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
  radius = max(look.a, 2.0 * pixel(centre)); // never too small to be seen
  vec3 back = toEye(centre);
  float away = length(eye - centre);
  vec3 side = normalize(cross(up, back));
  float widened = ortho ? radius : radius * away / sqrt(max(away * away - radius * radius, 0.01 * radius * radius));
  float reach = widened + 0.75 * pixel(centre);
  place = centre + reach * (corner.x * side + corner.y * cross(back, side));
  colour = i == held ? heldTint : look.rgb;
  gl_Position = matrix * vec4(place, 1.0);
}`;

export const SPHERE_FRAGMENT = COMMON + LIGHT + `
flat in vec3 centre, colour;
flat in float radius;
in vec3 place;
uniform float leastCover;
out vec4 result;
void main() {
  vec3 ray = -toEye(place);
  vec3 toCentre = centre - place;
  float along = dot(toCentre, ray);
  float miss = length(toCentre - along * ray);
  float cover = clamp((radius - miss) / max(fwidth(miss), 1e-12) + 0.5, 0.0, 1.0);
  if (cover <= leastCover) discard;
  vec3 hit = place + (along - sqrt(max(radius * radius - miss * miss, 0.0))) * ray;
  vec4 clip = matrix * vec4(hit, 1.0);
  gl_FragDepth = 0.5 + 0.5 * clip.z / clip.w;
  result = vec4(lit(colour, normalize(hit - centre), -ray), cover);
}`;

export const LINK_VERTEX = COMMON + SQUARES + `
uniform vec3 linkTint, slackTint, restTint, tautTint;
uniform float colourScale; // the stretch or tension in full colour; 0: not coloured
uniform bool byTension;
uniform sampler2D pulls; // tension of each link
out vec3 colour, side, front, place;
out float across;
void main() {
  vec4 link = row(rows, gl_VertexID / 4); // ends, radius, rest length
  vec2 corner = corner();
  vec3 a = at(int(link.x)), b = at(int(link.y));
  vec3 axis = b - a;
  float far = length(axis);
  vec3 centre = mix(a, b, 0.5 + 0.5 * corner.y);
  vec3 back = toEye(centre);
  side = cross(axis / max(far, 1e-12), back);
  side = length(side) > 1e-6 ? normalize(side) : right;
  front = normalize(back - dot(back, axis) / max(far * far, 1e-12) * axis);
  across = corner.x;
  float radius = max(link.z, 0.75 * pixel(centre));
  place = centre + radius * corner.x * side;
  float size = byTension ? row(pulls, gl_VertexID / 4).x : link.w > 0.0 ? far / link.w - 1.0 : 0.0;
  float t = colourScale > 0.0 ? clamp(size / colourScale, -1.0, 1.0) : 0.0;
  colour = mix(colourScale > 0.0 ? restTint : linkTint, t > 0.0 ? tautTint : slackTint, abs(t));
  gl_Position = matrix * vec4(place, 1.0);
}`;

export const LINK_FRAGMENT = COMMON + LIGHT + `
in vec3 colour, side, front, place;
in float across;
out vec4 result;
void main() {
  vec3 normal = across * side + sqrt(max(1.0 - across * across, 0.0)) * front;
  result = vec4(lit(colour, normalize(normal), toEye(place)), 1.0);
}`;

export const GROUND_VERTEX = COMMON + `
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

export const GROUND_FRAGMENT = COMMON + `
in vec3 world;
flat in float strength;
uniform vec3 middle, tint;
uniform float cell;
out vec4 result;
void main() {
  vec3 away = (world - middle) / (${(LINES / 4) | 0}.0 * cell);
  float grazing = smoothstep(0.0, 0.1, abs(toEye(world).y)); // far lines would run into each other
  result = vec4(tint, strength * exp(-dot(away, away)) * grazing);
}`;

export const SOLID_VERTEX = COMMON + `
in vec3 vertex, normal;
uniform vec3 centre, turn; // where it is, and the rotation vector [rad] by which it is turned
out vec3 place, facing;
vec3 turned(vec3 a) {
  float angle = length(turn);
  vec3 axis = angle > 0.0 ? turn / angle : vec3(0.0);
  return mix(axis * dot(axis, a), a, cos(angle)) + sin(angle) * cross(axis, a);
}
void main() {
  place = centre + turned(vertex);
  facing = turned(normal);
  gl_Position = matrix * vec4(place, 1.0);
}`;

export const SOLID_FRAGMENT = COMMON + LIGHT + `
in vec3 place, facing;
uniform vec3 tint;
out vec4 result;
void main() {
  vec3 back = toEye(place);
  vec3 n = normalize(facing);
  result = vec4(lit(tint, dot(n, back) < 0.0 ? -n : n, back), 1.0);
}`;

export const FLAT_VERTEX = COMMON + `
in vec3 vertex;
void main() { gl_Position = matrix * vec4(vertex, 1.0); }`;

export const FLAT_FRAGMENT = COMMON + `
uniform vec4 tint;
out vec4 result;
void main() { result = tint; }`;
