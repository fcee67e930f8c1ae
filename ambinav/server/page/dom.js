// Elements in a line: h("p", { class: "soft" }, "text", child).

const SVG = "http://www.w3.org/2000/svg";

function build(element, properties, children) {
  for (const [name, value] of Object.entries(properties ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "style") {
      // Through the object model: a strict content policy forbids the attribute.
      for (const [key, entry] of Object.entries(value)) element.style.setProperty(key, entry);
    } else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.flat(2).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** An HTML element; properties that begin with "on" are listeners. */
export function h(tag, properties, ...children) {
  return build(document.createElement(tag), properties, children);
}

/** An SVG element. */
export function svg(tag, properties, ...children) {
  return build(document.createElementNS(SVG, tag), properties, children);
}

/** Put children in place of what an element holds. */
export function fill(element, ...children) {
  element.replaceChildren(...children.flat(2).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Call `action` at most once a frame, with the arguments of the latest call. */
export function eachFrame(action) {
  let latest = null;
  return (...values) => {
    if (latest === null) {
      requestAnimationFrame(() => {
        const now = latest;
        latest = null;
        action(...now);
      });
    }
    latest = values;
  };
}

/** Say a text in a status, with the seconds that it lasts beside it; returns what ends that. */
export function saySeconds(status, text) {
  const begun = performance.now();
  // A status is read out whenever it changes, so screen readers are not to hear the seconds.
  const seconds = h("span", { "aria-hidden": "true" });
  fill(status, text, seconds);
  const timer = setInterval(() => (seconds.textContent = ` ${Math.round((performance.now() - begun) / 1000)} s`), 1000);
  return () => clearInterval(timer);
}

/** Call `action` once nothing has called for some milliseconds. */
export function settled(action, milliseconds) {
  let timer = 0;
  const call = (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => {
      timer = 0;
      action(...values);
    }, milliseconds);
  };
  /** Leave out what would be called; whether something would. */
  call.cancel = () => {
    const isPending = timer !== 0;
    clearTimeout(timer);
    timer = 0;
    return isPending;
  };
  return call;
}
