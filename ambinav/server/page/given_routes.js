// The routes of a comparison: given, not planned; one pair at a time.

import { fill, h } from "./dom.js";
import { routeCard } from "./routes_panel.js";

/** Build the panel; routes are {pair, name, kind, style, length, exposure, route}. */
export function givenRoutes(element, routes, floor, store) {
  const pairs = [...new Set(routes.map(({ pair }) => pair))];
  const cards = h("div", { class: "routes" });
  const choose = h("select", { id: "pair", onchange: () => show(choose.value) }, pairs.map((pair) => h("option", { value: pair }, pair)));
  fill(element, pairs.length > 1 && h("p", { class: "field" }, h("label", { for: "pair" }, "Pair"), choose), cards);
  const show = (pair) => {
    const shown = routes.filter((one) => one.pair === pair).map((one, i) => ({ ...one, key: `${pair}/${i}` }));
    const [first] = shown;
    store.set({ routes: shown, chosen: null, start: first.route[0].slice(0, 2), goal: first.route.at(-1).slice(0, 2) });
  };
  store.watch(["routes", "chosen"], ({ routes: shown, chosen }) => {
    const than = shown?.find(({ baseline }) => baseline);
    fill(cards, (shown ?? []).map((one) => routeCard(one, than, { chosen: one.key === chosen, choose: () => store.set({ chosen: one.key === chosen ? null : one.key }) })));
  });
  show(pairs[0]);
  return { show: (pair) => {
    if (!pairs.includes(pair)) return;
    choose.value = pair;
    show(pair);
  } };
}
