// The page of the service: header, choice of the map, explorer.

import { Comparison } from "./comparison.js";
import { fill, h } from "./dom.js";
import * as editor from "./editor.js";
import { makeExplorer } from "./explorer.js";
import { HttpSource } from "./http_source.js";
import { applyColours, currentTheme, followTheme, setTheme } from "./theme.js";
import { followView, readView, showView } from "./view_link.js";

const byId = (id) => document.getElementById(id);

async function start() {
  // A token that is added to the address of the open page is taken as one that it is opened with.
  addEventListener("hashchange", () => location.hash.includes("token=") && location.reload());
  applyColours();
  setTheme(currentTheme());
  const source = new HttpSource();
  const explorer = makeExplorer(byId("explorer"), source, { editor });
  followTheme(byId("theme"), explorer.store);
  source.connection = (isUp) => {
    byId("connection").hidden = isUp;
  };
  let maps;
  try {
    maps = await source.maps();
  } catch (problem) {
    const remedy = "Open the page as …/#token=TOKEN.";
    const refusal = `${source.token ? "The token is not that of this service." : "This service asks for a token."} ${remedy}`;
    fail(problem.status === 401 ? refusal : problem.message);
    return;
  }
  if (!maps.length) {
    fail("The service has no map to show.");
    return;
  }
  const asked = readView();
  const first = maps.find(({ id }) => id === asked.map) ?? maps[0];
  const open = async (map) => {
    byId("failure").hidden = true;
    document.title = `${map.name} · ambinav`;
    fill(byId("about-map"), [map.scanner, `${size(map)} m`, `cells of ${Number(map.spacing.toPrecision(3))} m`].join(" · "));
    try {
      await explorer.open(map);
    } catch (problem) {
      fail(problem.message);
      throw problem;
    }
  };
  choice(maps, first, open);
  new Comparison(document.querySelector(".stage"), byId("compare"), explorer.floor, source, explorer.store, maps);
  await open(first);
  showView(asked, explorer.floor, explorer.store);
  followView(explorer.floor, explorer.store);
}

function choice(maps, first, open) {
  if (maps.length === 1) {
    fill(byId("map-name"), first.name);
    return;
  }
  const select = h("select", { "aria-label": "Map", onchange: () => {
    const map = maps.find(({ id }) => id === select.value);
    open(map);
  } }, maps.map(({ id, name }) => h("option", { value: id, selected: id === first.id }, name)));
  fill(byId("map-name"), select);
}

const size = ({ bounds: [x0, y0, x1, y1] }) => `${Math.round(x1 - x0)} × ${Math.round(y1 - y0)}`;

function fail(text) {
  const note = byId("failure");
  note.textContent = text;
  note.hidden = false;
  document.querySelector(".stage").removeAttribute("aria-busy");
}

start();
