// The team of auv_lse fleet watch: what the laptop knows of each vehicle, how old it is, and alarms with a sound.

import { vehicleColor } from "./colors.js";
import { element, setText } from "./format.js";

export class TeamView {
  constructor(root, sound) {
    [this.root, this.sound, this.audio, this.known, this.key] = [root, sound, null, new Set(), ""];
    this.head = element("tr");
    this.body = element("tbody");
    this.lines = element("p", { role: "alert", "data-level": "error" });
    const table = element("table", {}, element("thead", {}, this.head), this.body);
    root.append(element("div", { class: "rows", tabindex: "0", role: "region", "aria-label": "Team" }, table), this.lines);
    sound.addEventListener("click", () => this.toggleSound());
  }

  // Browsers play sounds only after a click.
  toggleSound() {
    if (this.audio) this.audio.close();
    this.audio = this.audio ? null : new AudioContext();
    this.sound.setAttribute("aria-pressed", String(Boolean(this.audio)));
    this.beep();
  }

  beep() {
    if (!this.audio) return;
    const tone = this.audio.createOscillator();
    tone.frequency.value = 880;
    tone.connect(this.audio.destination);
    tone.start();
    tone.stop(this.audio.currentTime + 0.4);
  }

  // `team`: {columns, vehicles: [{number, cells, expected}], lines}; undefined on the page of a single mission. While
  // the server does not answer, what is shown gets no younger: that is an alarm, too.
  update(team, lost) {
    this.root.hidden = this.sound.hidden = !team;
    if (!team) return;
    const lines = [...(lost ? ["auv_lse fleet watch does not answer: what is shown is old."] : []), ...team.lines];
    const key = JSON.stringify([team, lines]);
    if (key === this.key) return;
    this.key = key;
    this.head.replaceChildren(...["vehicle", ...team.columns].map((text) => element("th", { scope: "col" }, text)));
    this.body.replaceChildren(...team.vehicles.map(({ number, cells }) => {
      const swatch = element("span", { class: "swatch", style: `background: ${vehicleColor(number)}` });
      return element("tr", {}, element("td", {}, swatch, ` auv${number}`), ...cells.map((text) => element("td", {}, text)));
    }));
    setText(this.lines, lines.join("\n"));
    if (lines.some((text) => !this.known.has(text))) this.beep();
    this.known = new Set(lines);
  }
}
