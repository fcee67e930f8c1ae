// Planning: start and goal, weight, routes side by side, and the trade-off curve.

import { fill, h, saySeconds, settled } from "./dom.js";
import { ForecastChoice, forecastText } from "./forecast.js";
import { metres, number, percent } from "./format.js";
import { paretoChart } from "./pareto_chart.js";
import { routeStyle } from "./route_lines.js";

const WEIGHTS = [0, 0.5, 1, 2, 3, 5, 8, 12, 20, 35, 50];
const CURVE = [0, 0.5, 1, 2, 5, 12, 20, 50];

export class RoutesPanel {
  #planning = null;
  #count = 0;
  /** Weights of the list, also while their routes are planned again or cannot be planned. */
  #weights = new Set();

  constructor(element, floor, source, store) {
    Object.assign(this, { element, floor, source, store });
    this.message = h("p", { class: "message", role: "status" });
    this.table = h("div", { class: "routes" });
    this.curve = h("div", { class: "curve" });
    this.robots = new ForecastChoice(() => this.#anew());
    this.#build();
    store.watch(["routes", "chosen"], () => this.#list());
    this.again = settled(() => this.#planAll(), 60);
    store.watch(["start", "goal"], () => {
      this.#fields();
      this.#anew();
    });
  }

  /** A map was opened: nothing is planned in it yet. */
  opened(map) {
    this.map = map;
    this.#weights.clear();
    this.#planning?.abort();
    this.store.set({ start: null, goal: null, routes: [], trial: null, chosen: null });
    this.say("");
  }

  /** Another version of the map is shown: plan in it what was planned. */
  changed() {
    if (this.#weights.size) this.again();
  }

  /** The details of the open map have come. */
  described({ forecast }) {
    this.robots.offer(forecast);
  }

  /** Take a click on the floor as the start, then the goal, then neither. */
  take({ x, y }) {
    const { start, goal } = this.store.values;
    if (!start) this.store.set({ start: [x, y] });
    else if (!goal) this.store.set({ goal: [x, y] });
    else return false;
    return true;
  }

  say(text, isError = false) {
    this.message.textContent = text;
    this.message.classList.toggle("error", isError);
  }

  #build() {
    const { store } = this;
    this.inputs = Object.fromEntries(["start", "goal"].map((name) => [name, ["x", "y"].map((axis) =>
      h("input", { type: "number", step: "0.1", "aria-label": `${name} ${axis}, metres`, placeholder: axis, onchange: () => this.#typed(name) }))]));
    const said = h("output", {}, `${number(store.get("weight"), 1)}`);
    const slider = h("input", { type: "range", min: 0, max: WEIGHTS.length - 1, step: 1, value: WEIGHTS.indexOf(store.get("weight")),
      id: "weight", "aria-valuetext": `weight ${store.get("weight")}`, oninput: () => {
        const weight = WEIGHTS[Number(slider.value)];
        slider.setAttribute("aria-valuetext", `weight ${weight}`);
        store.set({ weight });
      } });
    store.watch(["weight"], ({ weight }) => {
      said.textContent = number(weight, weight % 1 ? 1 : 0);
      const at = WEIGHTS.indexOf(weight);
      if (at >= 0) slider.value = String(at);
    });
    const end = (name, text) => h("div", { class: "end" }, h("span", { class: `badge ${name}` }, text), h("span", { class: "name" }, name === "start" ? "Start" : "Goal"), this.inputs[name], h("span", { class: "soft" }, "m"));
    this.planButton = h("button", { class: "primary", disabled: true, onclick: () => this.#plan(store.get("weight")) }, "Add a route");
    this.curveButton = h("button", { disabled: true, onclick: () => this.#trade() }, "Trade-off curve");
    this.cancelButton = h("button", { hidden: true, onclick: () => this.#planning?.abort() }, "Cancel");
    fill(this.element,
      h("p", { class: "soft" }, "Click the floor for the start, then for the goal. Drag either to plan again."),
      h("fieldset", { class: "ends-of-route" }, h("legend", {}, "From and to"), end("start", "S"), end("goal", "G")),
      h("fieldset", {}, h("legend", {}, h("label", { for: "weight" }, "Weight of ambiguity")),
        h("div", { class: "slider" }, slider, said),
        h("p", { class: "soft" }, "Extra metres that a metre of fully ambiguous floor is worth. At 0 the route is the shortest.")),
      this.robots.element,
      h("div", { class: "buttons" }, this.planButton, this.curveButton, this.cancelButton),
      this.message, this.table, this.curve);
  }

  #typed(name) {
    const [x, y] = this.inputs[name].map(({ value }) => (value === "" ? NaN : Number(value)));
    if (Number.isFinite(x) && Number.isFinite(y)) this.store.set({ [name]: [x, y] });
  }

  /** Plan for another start, goal or robot. */
  #anew() {
    const { start, goal } = this.store.values;
    fill(this.curve);
    this.store.set({ trial: null });
    if (start && goal) this.again();
  }

  #fields() {
    const { start, goal } = this.store.values;
    for (const [name, place] of [["start", start], ["goal", goal]]) {
      this.inputs[name].forEach((input, i) => (input.value = place ? place[i].toFixed(2) : ""));
    }
    this.planButton.disabled = this.curveButton.disabled = !(start && goal);
  }

  /** Plan every weight of the list again; the shortest and the chosen weight at first. */
  async #planAll() {
    const first = [0, this.store.get("weight")];
    const weights = this.#weights.size ? [...this.#weights] : [...new Set(first)];
    this.store.set({ routes: [], chosen: null });
    for (const weight of weights) {
      if (!(await this.#plan(weight))) break;
      // All of them stay in the list, whatever comes between the first and the last.
      if (weight === weights[0]) for (const planned of weights) this.#weights.add(planned);
    }
  }

  #request() {
    const { start, goal } = this.store.values;
    return { start, goal, ...this.robots.request };
  }

  /** Run one job that can be cancelled; returns its answer, or null. */
  async #run(text, job) {
    this.#planning?.abort();
    const mine = (this.#planning = new AbortController());
    this.say("");
    const end = saySeconds(this.message, text);
    this.cancelButton.hidden = false;
    this.element.setAttribute("aria-busy", "true");
    try {
      const found = await job(mine.signal).finally(end);
      this.say("");
      return found;
    } catch (problem) {
      if (mine === this.#planning) this.say(problem.name === "AbortError" ? "Cancelled." : problem.message, problem.name !== "AbortError");
      return null;
    } finally {
      if (mine === this.#planning) {
        this.cancelButton.hidden = true;
        this.element.removeAttribute("aria-busy");
      }
    }
  }

  async #plan(weight) {
    const id = this.floor.shown;
    const found = await this.#run("Planning …", (signal) => this.source.plan(id, { ...this.#request(), weight }, signal));
    if (found && this.floor.shown !== id) this.again();
    if (!found || this.floor.shown !== id) return false;
    this.#weights.add(weight);
    const others = this.store.get("routes").filter((one) => one.weight !== weight);
    const kind = weight === 0 ? "shortest" : "ambiguity";
    const taken = others.filter((one) => one.kind === kind).map(({ number: taken }) => taken);
    let free = 0;
    while (taken.includes(free)) free += 1;
    const key = `route-${++this.#count}`;
    const fresh = { ...found, weight, kind, key, number: free, style: routeStyle(kind, free), name: weight === 0 ? "Shortest" : `Weight ${number(weight, weight % 1 ? 1 : 0)}` };
    this.store.set({ routes: [...others, fresh].sort((a, b) => a.weight - b.weight), chosen: key });
    return true;
  }

  async #trade() {
    // Of a place that was just typed the routes are planned first.
    if (this.again.cancel()) await this.#planAll();
    const id = this.floor.shown;
    const found = await this.#run("Planning one route for each weight …", (signal) =>
      this.source.pareto(id, { ...this.#request(), weights: CURVE }, signal));
    if (!found || this.floor.shown !== id) return;
    const points = Array.isArray(found) ? found : (found.points ?? found.routes);
    fill(this.curve, paretoChart(points, (point) => {
      this.store.set({ trial: { ...point, key: "trial", name: point.label, style: routeStyle("ambiguity", 1) }, chosen: "trial", weight: point.weight });
    }));
  }

  #list() {
    const { routes, chosen } = this.store.values;
    const shortest = routes?.find(({ weight }) => weight === 0);
    fill(this.table, (routes ?? []).map((one) => routeCard(one, shortest, {
      chosen: one.key === chosen,
      choose: () => this.store.set({ chosen: one.key }),
      remove: () => {
        this.#weights.delete(one.weight);
        this.store.set({ routes: routes.filter(({ key }) => key !== one.key) });
      },
    })));
  }
}

/** A route with its figures; `than` is what it is compared with. */
export function routeCard(one, than, { chosen, choose, remove }) {
  const change = (name) => {
    if (!than || than === one || !(than[name] > 0)) return "";
    const share = (100 * (one[name] - than[name])) / than[name];
    return h("small", { class: "soft" }, ` ${share > 0 ? "+" : "−"}${Math.abs(share).toFixed(0)} %`);
  };
  return h("div", { class: `route-card${chosen ? " chosen" : ""}` },
    h("button", { class: "route-name", "aria-pressed": String(Boolean(chosen)), onclick: choose }, routeSample(one.style), h("b", {}, one.name)),
    remove && h("button", { class: "close", "aria-label": `Remove ${one.name}`, onclick: remove }, "×"),
    h("dl", {}, [["Length", metres(one.length), "length"], ["Exposure", metres(one.exposure, 2), "exposure"], one.forecast && ["Lost", percent(one.forecast.lost_probability), ""]]
      .filter(Boolean).map(([name, text, key]) => [h("dt", {}, name), h("dd", {}, text, change(key))])),
    forecastText(one));
}

/** A piece of a route's line, for lists. */
export function routeSample({ colour, casing, dashes }) {
  const ink = dashes.length ? `repeating-linear-gradient(to right, ${colour} 0 6px, ${casing} 6px 9px)` : colour;
  return h("span", { class: "sample", style: { background: ink, "--casing": casing } });
}
