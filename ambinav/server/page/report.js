// A report: the explorer in place of the picture of the floor, fed by what is embedded.

import { EmbeddedSource } from "./embedded_source.js";
import { makeExplorer } from "./explorer.js";
import { applyColours, currentTheme, followTheme, setTheme } from "./theme.js";

async function start() {
  applyColours();
  setTheme(currentTheme());
  const data = JSON.parse(document.getElementById("ambinav-data").textContent);
  const source = new EmbeddedSource(data);
  const root = document.getElementById("explorer");
  const routes = await source.routes();
  document.documentElement.classList.add("explored");
  const explorer = makeExplorer(root, source, { tab: routes.length ? "routes" : "layers", routes });
  followTheme(document.getElementById("theme"), explorer.store);
  const [map] = await source.maps();
  await explorer.open(map);
  // Rows and cards of the report that stand for a place or a pair show it on the map.
  for (const element of document.querySelectorAll("[data-place], [data-pair]")) {
    element.addEventListener("click", () => {
      root.scrollIntoView({ block: "start", behavior: "auto" });
      if (element.dataset.pair) explorer.store.get("given")?.show(element.dataset.pair);
      else explorer.store.set({ place: Number(element.dataset.place) - 1, tab: "places" });
    });
  }
}

start();
