// The forecast of lost robots: of which robots it is, on a card, and along a route.

import { fill, h } from "./dom.js";
import { metres, percent, sentence } from "./format.js";

/** A choice of the robots that are forecast; `changed` is called when another is made. */
export class ForecastChoice {
  constructor(changed) {
    this.said = h("p", { class: "soft" });
    const choose = () => {
      this.#say();
      changed();
    };
    this.selects = Object.fromEntries(["odometry", "localizer"].map((name) => [name, h("select", { id: name, onchange: choose })]));
    this.element = h("fieldset", { class: "robots", hidden: true }, h("legend", {}, "Forecast of lost robots"),
      Object.entries(this.selects).map(([name, select]) => h("label", { for: name }, sentence(name), select)),
      this.said);
  }

  /** Offer what the details of a map allow; what was chosen stays if it can. */
  offer({ odometries, localizers, ...usual }) {
    for (const [name, entries] of Object.entries({ odometry: odometries, localizer: localizers })) {
      const select = this.selects[name];
      const chosen = [select.value, usual[name]].find((value) => entries.some((entry) => entry.name === value));
      fill(select, entries.map((entry) => h("option", { value: entry.name, title: entry.title }, entry.name)));
      if (chosen) select.value = chosen;
    }
    this.element.hidden = !localizers.length;
    this.#say();
  }

  /** Fields of a request; none before a map offers some. */
  get request() {
    return Object.fromEntries(Object.entries(this.selects).map(([name, { value }]) => [name, value || undefined]));
  }

  #say() {
    const titles = Object.values(this.selects).map(({ selectedOptions: [option] }) => option?.title ?? "");
    this.said.textContent = `${sentence(titles.join("; "))}. Red beads: where robots get lost; point at a route for their share.`;
  }
}

/** What a card says of a route's forecast; nothing where none was asked for. */
export function forecastText({ forecast, forecast_reason: reason }) {
  if (forecast) return h("p", {}, sentence(forecast.text));
  return reason ? h("p", { class: "soft" }, `No forecast: ${reason}`) : null;
}

/** The stretches of a forecast that lose robots, as lines of [x, y]. */
export function lossLines({ causes, curve }) {
  return causes.map(({ start_m: start, end_m: end }) =>
    curve.filter(({ distance_m: at }) => at >= start && at <= end).map(({ x_m: x, y_m: y }) => [x, y]));
}

/** The place of a forecast that is nearest to a point. */
export function nearestPlace({ curve }, x, y) {
  const off = (place) => Math.hypot(place.x_m - x, place.y_m - y);
  return curve.reduce((best, place) => (off(place) < off(best) ? place : best));
}

/** What a tooltip says of a place of a route. */
export function tipText({ name }, { distance_m: at, lost, error_m: error }) {
  const rows = [["after", metres(at)], ["lost so far", percent(lost)], ["error", metres(error, 2)]];
  return h("div", { "data-lost": lost }, h("b", {}, name), h("dl", {}, rows.map(([term, text]) => [h("dt", {}, term), h("dd", {}, text)])));
}
