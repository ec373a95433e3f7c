// What links are coloured by, and the legend that says so.

const LEAST = { stretch: 1e-4, tension: 1e-6 }; // smaller is round-off, and not worth a colour
const UNITS = { stretch: ["%", 100], tension: ["N", 1] };

// For Drawing.draw; null where links have a colour of their own. by: "stretch", "tension" or "" for neither; most: the
// largest size of it that is to be told apart; tension: of each link [N].
export function colouring(by, most, tension) {
  const show = (id, text) => { document.getElementById(id).textContent = text; };
  document.getElementById("legend").hidden = !by;
  if (!by) return null;
  const scale = niceAbove(Math.max(most, LEAST[by]));
  const [unit, factor] = UNITS[by];
  const end = +(factor * scale).toPrecision(1);
  show("legend-low", `−${end} ${unit}`);
  show("legend-high", `+${end} ${unit}`);
  return { scale, tension: by === "tension" ? tension : null };
}

export function largest(values) {
  let most = 0;
  for (const value of values) most = Math.max(most, Math.abs(value));
  return most;
}

// The first of ..., 0.1, 0.2, 0.5, 1, 2, ... that is not below a value.
function niceAbove(value) {
  const ten = 10 ** Math.floor(Math.log10(value));
  return ten * [1, 2, 5, 10].find((step) => step * ten >= value * (1 - 1e-9));
}
