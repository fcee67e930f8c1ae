// The trade-off between length and exposure: one point for each weight.

import { h, svg } from "./dom.js";
import { metres, number, percent } from "./format.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [320, 210, 52, 14, 14, 44];

/** A chart of points {weight, length, exposure}; `choose` is called with the one that is chosen. */
export function paretoChart(points, choose) {
  const shown = points.filter(({ length, exposure }) => Number.isFinite(length) && Number.isFinite(exposure));
  const across = scale(shown.map(({ length }) => length), LEFT, WIDTH - RIGHT);
  const up = scale(shown.map(({ exposure }) => exposure), HEIGHT - BOTTOM, TOP);
  const front = together([...shown].sort((a, b) => a.length - b.length || a.exposure - b.exposure), across, up);
  const line = front.map(({ length, exposure }) => `${across.at(length).toFixed(1)},${up.at(exposure).toFixed(1)}`).join(" ");
  const said = h("p", { class: "soft", role: "status" }, "Choose a point to see its route.");
  const dots = new Map();
  const pick = (point) => {
    for (const [one, dot] of dots) {
      dot.classList.toggle("chosen", one === point);
      dot.setAttribute("aria-pressed", String(one === point));
    }
    said.textContent = `${point.label}: ${metres(point.length)} long, exposure ${metres(point.exposure, 2)}${point.forecast ? `, ${percent(point.forecast.lost_probability)} of robots lost` : ""}.`;
    choose(point);
  };
  for (const point of front) {
    const label = `${point.label}: length ${metres(point.length)}, exposure ${metres(point.exposure, 2)}`;
    dots.set(point, svg("circle", {
      cx: across.at(point.length).toFixed(1), cy: up.at(point.exposure).toFixed(1), r: 6, class: "dot", tabindex: 0, role: "button",
      "aria-label": label, "aria-pressed": "false", onclick: () => pick(point),
      onkeydown: (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        pick(point);
      },
    }, svg("title", {}, label)));
  }
  return h("figure", { class: "chart" },
    h("figcaption", {}, "What a longer route buys"),
    svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "group", "aria-label": "Exposure over length, one point for each weight" },
      across.ticks.map((value) => [
        svg("line", { class: "tick", x1: across.at(value), x2: across.at(value), y1: TOP, y2: HEIGHT - BOTTOM }),
        svg("text", { x: across.at(value), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, number(value, across.digits)),
      ]),
      up.ticks.map((value) => [
        svg("line", { class: "tick", x1: LEFT, x2: WIDTH - RIGHT, y1: up.at(value), y2: up.at(value) }),
        svg("text", { x: LEFT - 8, y: up.at(value) + 4, "text-anchor": "end" }, number(value, up.digits)),
      ]),
      svg("text", { class: "axis-name", x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 6, "text-anchor": "middle" }, "Length (m)"),
      svg("text", { class: "axis-name", x: -(TOP + HEIGHT - BOTTOM) / 2, y: 13, transform: "rotate(-90)", "text-anchor": "middle" }, "Exposure (m)"),
      svg("polyline", { class: "front", points: line }),
      [...dots.values()]),
    said);
}

/** Points of one place on the chart as one: often several weights lead to the same route. */
function together(points, across, up) {
  const kept = [];
  for (const point of points) {
    const near = kept.find((one) => Math.hypot(across.at(one.length) - across.at(point.length), up.at(one.exposure) - up.at(point.exposure)) < 6);
    if (near) near.weights.push(point.weight);
    else kept.push({ ...point, weights: [point.weight] });
  }
  return kept.map((point) => {
    const [low, high] = [Math.min(...point.weights), Math.max(...point.weights)].map((weight) => number(weight, weight % 1 ? 1 : 0));
    return { ...point, weight: Math.min(...point.weights), label: low === high ? `Weight ${low}` : `Weights ${low} to ${high}` };
  });
}

/** An axis from the values to pixels, with round ticks. */
function scale(values, from, to) {
  const [low, high] = values.length ? [Math.min(...values), Math.max(...values)] : [0, 1];
  const room = Math.max(high - low, 1e-3 * Math.max(Math.abs(high), 1)) * 0.12;
  const [first, last] = [low - room, high + room];
  const rough = (last - first) / 4;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((size) => size >= rough);
  const ticks = [];
  for (let value = Math.ceil(first / step) * step; value <= last; value += step) ticks.push(value);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return { at: (value) => from + ((value - first) / (last - first)) * (to - from), ticks, digits };
}
