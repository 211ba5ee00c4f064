// Buttons that command the vehicles: hold, surface, abort. Only with auv_lse live --control, and its token in the address.

import { clock, element, setText } from "./format.js";

const EFFECT = {
  hold: "holds its position until auv_lse go",
  surface: "comes up and stays at the surface until auv_lse go",
  abort: "ends its mission; safety.abort sets what it does then",
};
const MAX_SHOWN = 6;

export class Commands {
  // `mission()` gives the name of the mission that the server serves.
  constructor(root, dialog, store, mission) {
    [this.root, this.dialog, this.store, this.mission] = [root, dialog, store, mission];
    this.token = new URLSearchParams(location.hash.slice(1)).get("control") ?? "";
    this.to = element("select", { "aria-label": "Vehicles to command" });
    this.buttons = Object.keys(EFFECT).map((name) => {
      const button = element("button", { type: "button", "data-command": name }, `${title(name)}…`);
      button.addEventListener("click", () => this.ask(name));
      return button;
    });
    this.hint = element("p", { class: "soft" }, "To command the vehicles, open the address that auv_lse live --control printed.");
    this.log = element("ol", { role: "log", "aria-label": "Results of commands", tabindex: "0", hidden: "" });
    this.bar = element("div", { class: "bar" }, this.to, ...this.buttons);
    root.append(this.bar, this.hint, this.log);
  }

  update(source, vehicle) {
    const usable = Boolean(source.control && this.store.facts), all = this.store.facts?.vehicles.length ?? 0;
    this.root.hidden = !usable && !this.log.childElementCount;
    this.bar.hidden = !usable || !this.token;
    this.hint.hidden = !usable || Boolean(this.token);
    for (const button of this.buttons) button.disabled = source.connection !== "open";
    const key = `${vehicle} of ${all}`;
    if (!usable || this.to.dataset.key === key) return;
    const chosen = this.to.value === "all" ? "all" : "one";
    this.to.dataset.key = key;
    this.to.replaceChildren(element("option", { value: "one" }, `auv${vehicle}`));
    if (all > 1) this.to.append(element("option", { value: "all" }, `all ${all} vehicles`));
    if (all > 1) this.to.value = chosen;
    this.one = vehicle;
  }

  // Asks for confirmation, then sends.
  ask(name) {
    const all = this.store.facts.vehicles.map((v) => v.number), vehicles = this.to.value === "all" ? all : [this.one];
    const mission = this.mission(), [heading, text, form] = this.dialog.children;
    const whom = vehicles.length > 1 ? `all ${vehicles.length} vehicles` : `auv${vehicles[0]}`;
    setText(heading, `${title(name)} ${whom}?`);
    setText(text, `Mission ${this.store.facts.name}: ${vehicles.length > 1 ? "each vehicle" : whom} ${EFFECT[name]}.`);
    setText(form.querySelector("[value=yes]"), `${title(name)} ${whom}`);
    this.dialog.returnValue = "";
    this.dialog.onclose = () => this.dialog.returnValue === "yes" && this.send(mission, name, vehicles, whom);
    this.dialog.showModal();
  }

  async send(mission, command, vehicles, whom) {
    const row = element("li", {}, `${clock(this.store.lastS - this.store.startS)} ${title(command)} ${whom}: sent, waiting`);
    this.log.hidden = false;
    this.log.prepend(row);
    while (this.log.childElementCount > MAX_SHOWN) this.log.lastElementChild.remove();
    const begin = row.textContent.replace(" sent, waiting", "");
    try {
      const headers = { "Content-Type": "application/json", "X-Live-Token": this.token };
      const answer = await fetch("/command", { method: "POST", headers, body: JSON.stringify({ mission, command, vehicles }) });
      if (!answer.ok) throw new Error((await answer.text()).trim());
      row.replaceChildren(begin, ...outcomes(await answer.json()));
    } catch (error) {
      row.replaceChildren(begin, element("p", { "data-level": "error" }, `✖ not sent: ${error.message}`));
    }
  }
}

function title(name) {
  return name[0].toUpperCase() + name.slice(1);
}

// One line per different outcome, with the vehicles that it applies to.
function outcomes(answer) {
  const same = new Map();
  for (const [vehicle, { outcome, text }] of Object.entries(answer)) {
    const key = JSON.stringify([outcome, text]);
    same.set(key, [...(same.get(key) ?? []), `auv${vehicle}`]);
  }
  return [...same].map(([key, names]) => {
    const [outcome, text] = JSON.parse(key), good = outcome === "accepted";
    const line = `${good ? "✓" : "✖"} ${names.join(", ")}: ${outcome}${text ? ` (${text})` : ""}`;
    return element("p", { "data-level": good ? "ok" : "error" }, line);
  });
}
