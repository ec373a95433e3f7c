// Light or dark, as the system prefers.

const light = matchMedia("(prefers-color-scheme: light)");

export const scheme = () => (light.matches ? "light" : "dark");

export function onSchemeChange(act) {
  light.addEventListener("change", act);
}
