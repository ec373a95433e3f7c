// What the server and the page have to say: sentences with buttons, what one waits for, that nobody answers.

const $ = (id) => document.getElementById(id);
const SAID_FOR = 9000; // ms
const MOST = 3;
const PATIENCE = 250; // ms before it is said that something takes long

export class Messages {
  // say(type, fields): to the server.
  constructor(say) {
    this.say = say;
    this.patience = null;
    this.warned = "";
  }

  // A sentence, with the remedies that it names: { label, changes } each.
  tell(sentence, remedies = [], lasting = false) {
    const line = document.createElement("li");
    line.append(Object.assign(document.createElement("p"), { textContent: sentence }), ...this.buttons(remedies, () => line.remove()));
    const close = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: "×", title: "Close" });
    close.addEventListener("click", () => line.remove());
    line.append(close);
    $("said").append(line);
    while ($("said").children.length > MOST) $("said").firstChild.remove();
    if (!lasting) setTimeout(() => line.remove(), remedies.length ? 2 * SAID_FOR : SAID_FOR);
    return line;
  }

  buttons(remedies, done = () => {}) {
    return remedies.map(({ label, changes }) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: label });
      button.addEventListener("click", () => { this.say("change", { changes }); done(); });
      return button;
    });
  }

  // Why the simulation has stopped, and what is known to fail.
  status({ failure, remedies, warnings }) {
    if ((failure ?? "") !== this.failure) {
      this.failure = failure ?? "";
      $("failure").hidden = failure === null;
      $("failure").querySelector("p").textContent = this.failure;
      $("failure").querySelector(".remedies").replaceChildren(...this.buttons(remedies));
    }
    const text = warnings.length ? warnings[0].text : "";
    if (text === this.warned) return;
    this.warned = text;
    this.warning?.remove();
    if (text) this.warning = this.tell(`Known to fail: ${text}`, warnings[0].remedies, true);
  }

  // What everybody waits for, null for nothing.
  busy(text, compiling = null) {
    clearTimeout(this.patience);
    if (text === null) {
      $("busy").hidden = true;
      return;
    }
    $("busy").querySelector("p").textContent = `${text} …`;
    $("busy").querySelector("small").textContent = compiling ? `compiling ${compiling}; the first time takes a while` : "";
    this.patience = setTimeout(() => { $("busy").hidden = false; }, PATIENCE);
  }

  here() {
    $("away").hidden = true;
    this.ended = false;
  }

  away(code, reason) {
    this.ended ||= code === 1001;
    $("away").hidden = false;
    $("away").textContent = reason && code !== 1001 ? `The server has closed the connection: ${reason}.`
      : this.ended ? "pbd-warp view has ended. Start it again, and this page goes on."
        : "The server does not answer. Is pbd-warp view still running?";
  }

  async copy(text) {
    try {
      await navigator.clipboard.writeText(text);
      this.tell("The link is copied.");
    } catch { // not from this machine, or not allowed
      $("link").querySelector("input").value = text;
      $("link").showModal();
      $("link").querySelector("input").select();
    }
  }
}
