// The dialog in which one opens another scene, with parameters; and links that say the same.

const $ = (id) => document.getElementById(id);

export class SceneDialog {
  // scene(): the one that is shown; say(type, fields): to the server.
  constructor(scene, say) {
    this.scene = scene;
    $("scene").addEventListener("click", () => this.open());
    $("scenes").querySelector("[data-close]").addEventListener("click", () => $("scenes").close());
    $("scenes").querySelector("form").addEventListener("submit", () => {
      const parameters = {};
      for (const field of $("parameters").querySelectorAll("input")) {
        if (field.value !== field.dataset.default) parameters[field.name] = field.value;
      }
      say("open", { scene: this.chosen, parameters, changes: {} });
    });
  }

  open() {
    const { scenes, scene, parameters } = this.scene();
    $("choices").replaceChildren(...Object.entries(scenes).map(([name, { summary }]) => {
      const label = document.createElement("label");
      const radio = Object.assign(document.createElement("input"), { type: "radio", name: "scene", value: name, checked: name === scene });
      radio.addEventListener("change", () => this.choose(name, {}));
      const text = document.createElement("span");
      text.append(Object.assign(document.createElement("b"), { textContent: name }), ` ${summary}`);
      label.append(radio, text);
      label.addEventListener("dblclick", () => $("scenes").querySelector("form").requestSubmit());
      return label;
    }));
    this.choose(scene, parameters);
    $("scenes").showModal();
    $("choices").querySelector(":checked").focus();
  }

  // given: parameters that are not the defaults.
  choose(name, given) {
    this.chosen = name;
    const { text, parameters } = this.scene().scenes[name];
    const fields = Object.entries(parameters).map(([parameter, value]) => {
      const label = document.createElement("label");
      const field = Object.assign(document.createElement("input"), { name: parameter, value: given[parameter] ?? String(value) });
      if (typeof value === "number") field.inputMode = "decimal";
      field.dataset.default = String(value);
      label.append(parameter, field);
      return label;
    });
    const about = Object.assign(document.createElement("p"), { textContent: text.replaceAll("`", "") });
    $("parameters").replaceChildren(...fields, ...(fields.length ? [about] : []));
  }
}

// A link that opens this scene with these settings.
export function linkTo({ scene, parameters }, { settings }) {
  // null is what the scene has, but for a grab: exact.
  const changes = Object.fromEntries(Object.entries(settings).filter(([name, value]) => value !== null || name === "grab_acceleration"));
  const url = new URL(location.href);
  url.hash = new URLSearchParams({ open: JSON.stringify({ scene, parameters, changes }) });
  return url.href;
}

// What a link asks for, once: a reload shows what is there by then.
export function takeLink() {
  const wanted = new URLSearchParams(location.hash.slice(1)).get("open");
  if (wanted === null) return null;
  history.replaceState(null, "", location.pathname + location.search);
  try {
    const { scene, parameters, changes } = JSON.parse(wanted);
    return { scene, parameters, changes };
  } catch {
    return null;
  }
}
