// Notifications of the browser: one for each vehicle that becomes faulty, if the person asked for them.

import { $ } from "./dom.js";
import { sentences } from "./words.js";

export class DesktopNotices {
  #known = null;

  constructor() {
    const button = $("notify");
    button.hidden = !("Notification" in window);
    button.addEventListener("click", () => void this.#ask());
    this.#show();
  }

  /** Takes the faulty vehicles; those of the first call are no news. */
  take(faulty) {
    const fresh = this.#known && this.#wanted ? faulty.filter(({ key }) => !this.#known.has(key)) : [];
    for (const vehicle of fresh) {
      new Notification(`${vehicle.id} at ${vehicle.site}`, { body: sentences(vehicle.worst, "").join(" "), tag: vehicle.key });
    }
    this.#known = new Set(faulty.map(({ key }) => key));
  }

  get #wanted() {
    return localStorage.getItem("notify") === "yes" && window.Notification?.permission === "granted";
  }

  async #ask() {
    const granted = this.#wanted ? "off" : await Notification.requestPermission();
    localStorage.setItem("notify", granted === "granted" ? "yes" : "no");
    this.#show();
  }

  #show() {
    $("notify").setAttribute("aria-pressed", String(this.#wanted));
  }
}
