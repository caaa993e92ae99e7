// What hands do on the stage: pointers, keys, files that are dropped.

import { ARROWS, WAYS } from "./fly.js";
import { brush } from "./paint.js";
import { TOOLS } from "./tools.js";

const REACH = 20; // px from its middle within which a finger takes a device

/** The nearest of some elements to a pointer, nothing if all are farther than `most` px. */
function nearest(all, { clientX, clientY }, most = Infinity) {
  const far = (each) => {
    const { x, y, width, height } = each.getBoundingClientRect();
    return Math.hypot(x + width / 2 - clientX, y + height / 2 - clientY);
  };
  return [...all]
    .filter((each) => far(each) <= most)
    .sort((one, other) => far(one) - far(other))[0];
}

/** Listens to all that is done on a stage. */
export function attend(stage) {
  const { el, find, ask } = stage;
  const main = find(".main");
  const map = () => find(".map svg"); // each answer may draw it anew
  const tool = () => TOOLS[stage.scene.state.tool];
  let drag = null; // what is dragged, and the cell that it has come to
  let drags = 0; // how many there were

  const cellAt = (event) => {
    if (!drag && !event.target.closest?.(".map")) return null;
    const pointer = new DOMPoint(event.clientX, event.clientY);
    const { x, y } = pointer.matrixTransform(map().getScreenCTM().inverse());
    const [row, col] = [Math.round(y), Math.round(x)];
    return stage.scene.film.city[row]?.[col] === undefined ? null : [row, col];
  };
  /** The number of the device in a cell, −1 for the start, or null. */
  const thingAt = (cell) => {
    const here = ([row, col]) => row === cell[0] && col === cell[1];
    const { devices, start } = stage.scene.state;
    const device = devices.findIndex((each) => here(each.cell));
    return device >= 0 ? device : here(start) ? -1 : null;
  };
  /** What a pointer takes: what is in its cell; a finger that does not paint, also what is near. */
  const taken = (event, cell) => {
    const thing = cell && thingAt(cell);
    const exact = event.pointerType !== "touch" || tool() === TOOLS.paint;
    if (thing !== null || exact) return thing;
    const things = event.target.closest(".map").querySelectorAll("g[data-device]");
    const beside = nearest(things, event, REACH);
    return beside ? Number(beside.dataset.device) : null;
  };
  const hover = (cell) => {
    stage.hovered = cell;
    stage.point();
  };
  const seek = ({ target, clientX, buttons }) => {
    const chart = target.closest?.(".chart svg");
    if (!chart || !buttons) return;
    const { x } = new DOMPoint(clientX, 0).matrixTransform(chart.getScreenCTM().inverse());
    stage.seek(x);
  };
  main.addEventListener("pointerdown", seek);
  main.addEventListener("pointermove", seek);
  main.addEventListener("pointerdown", (event) => {
    if (!event.target.closest(".map") || event.button) return;
    const cell = cellAt(event);
    const thing = taken(event, cell);
    if (!cell && thing === null) return;
    const { tool: name } = stage.scene.state;
    hover(cell); // a finger does not hover
    if (name === "channel" && thing !== null && thing >= 0) ask({ kind: "look", device: thing });
    const painting = name === "paint" && thing === null;
    if (!painting && thing === null) return;
    event.preventDefault();
    main.setPointerCapture(event.pointerId);
    drag = { thing, at: cell, number: (drags += 1) };
    if (!painting) return;
    brush.cells = [];
    stroke(cell);
  });
  const move = (event) => {
    const cell = cellAt(event);
    if (!drag) {
      if (event.target.closest?.(".map")) hover(cell);
      else if (stage.hovered && event.pointerType !== "touch" && !find(".map svg:focus-visible"))
        hover(null);
      return;
    }
    if (!cell || String(cell) === String(drag.at)) return;
    const before = drag.at;
    stage.hovered = drag.at = cell;
    drag.moves = true;
    if (brush.cells) strokeTo(cell, before);
    else stage.askWhenFree(moves(drag.thing, cell, { drag: drag.number }));
  };
  /** In Think a device moves for a try; elsewhere the mission changes. */
  const moves = (device, cell, more = {}) => ({
    kind: device >= 0 && stage.scene.state.tool === "think" ? "whatIf" : "move",
    ...{ device, cell, ...more },
  });
  main.addEventListener("pointermove", move);
  main.addEventListener("pointerleave", ({ pointerType }) => {
    if (!drag && pointerType !== "touch") hover(null);
  });
  const release = (event) => {
    if (drag && event.type === "pointerup") move(event); // where it is let go is where it stays
    if (brush.cells) ask({ kind: "paint", cells: brush.cells, sign: brush.sign });
    else if (drag?.moves) ask(moves(drag.thing, drag.at, { drag: drag.number, ends: true }));
    [drag, brush.cells] = [null, null];
  };
  main.addEventListener("pointerup", release);
  main.addEventListener("pointercancel", release);

  /** Paints all cells on the way, however fast the pointer is. */
  function strokeTo(cell, before) {
    const ways = cell.map((each, axis) => each - before[axis]);
    const count = Math.max(...ways.map(Math.abs));
    for (let k = 1; k <= count; k += 1) {
      stroke(before.map((each, axis) => Math.round(each + (k / count) * ways[axis])));
    }
  }

  function stroke(cell) {
    if (brush.cells.some((each) => String(each) === String(cell))) return;
    brush.cells.push(cell);
    stage.fresh();
  }

  const does = {
    skip: stage.endStory,
    go: stage.goOn,
    tell: stage.tellStory,
    refusal: () => stage.refuse(""),
    more: () => (find(".drawer").open ? find(".drawer").close() : find(".drawer").show()),
  };
  el.addEventListener("click", (event) => {
    const target = event.target.closest("button, [data-ask], .refusal");
    if (!target) return;
    const { ask: asked, tool: name, sign } = target.dataset;
    if (!target.closest(".caption, .controls")) stage.endStory();
    const does_ = Object.keys(does).find((each) => target.classList.contains(each));
    if (asked) [JSON.parse(asked)].flat().forEach(ask);
    else if (name) ask({ kind: "tool", tool: name });
    else if (sign) {
      brush.sign = sign;
      stage.paint();
    } else if (does_) does[does_](target);
    // Keys steer after a press, too, unless it asks for a place or a number
    const steers =
      name === "fly" || (stage.scene.state.tool === "fly" && !target.closest(".drawer"));
    const begins = /"(again|new)"/.test(asked);
    if (steers && (event.detail || name || begins)) find("#panel").focus({ preventScroll: true });
  });

  el.addEventListener("input", ({ target }) => {
    if (target.dataset.set !== "whatif-time") return;
    stage.askWhenFree({ kind: "whatIf", time: target.valueAsNumber });
  });
  el.addEventListener("change", ({ target }) => {
    const { set, field } = target.dataset;
    const { value } = target;
    const { looks } = stage.scene.state;
    const steers = stage.scene.state.tool === "fly" && set && !target.matches(":focus-visible");
    if (steers) find("#panel").focus({ preventScroll: true });
    if (set === "city") ask({ kind: "city", name: value });
    else if (set?.startsWith("policy-"))
      ask({ kind: "policy", which: Number(set.at(-1)), name: value });
    else if (set in looks)
      ask({ kind: "see", name: set, value: target.type === "checkbox" ? target.checked : value });
    if (field && target.reportValidity()) {
      const [name, device] = field.split(" ");
      for (const place of [".devices", ".fields"]) find(place).written = null; // a refused one is put back
      ask({ kind: name, device: Number(device), value: target.valueAsNumber });
    }
    if (target.files?.length) {
      open(target.files);
      target.value = ""; // so that the same file can be opened again
    }
  });

  /** Sends what a file holds: not every engine lets a worker read the file itself. */
  const open = async ([file]) => {
    stage.endStory();
    const bytes = new Uint8Array(await file.arrayBuffer());
    ask({ kind: "open", file: { name: file.name, bytes } });
  };
  el.addEventListener("dragover", (event) => event.preventDefault());
  el.addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files.length) open(event.dataTransfer.files);
  });

  /** What a key does, or null: it steers, or moves what has the focus. */
  function keyed({ key, target, ctrlKey, metaKey, shiftKey }) {
    const { tools, state } = stage.scene;
    const by = { z: shiftKey ? 1 : -1, Z: 1, y: 1 }[key];
    if (ctrlKey || metaKey) return by ? () => ask({ kind: "undo", by }) : null;
    const [down, right] = WAYS[ARROWS[key]] ?? [];
    const tab = target.closest("[role=tab]");
    if (tab && (right || ["Home", "End"].includes(key))) {
      const to =
        { Home: tools[0], End: tools.at(-1) }[key] ??
        tools[(tools.indexOf(tab.dataset.tool) + right + tools.length) % tools.length];
      return () => find(`#tab-${to}`).focus();
    }
    if (tab && ["Enter", " ", "ArrowDown"].includes(key)) {
      return () => {
        find("#panel").focus({ preventScroll: true });
        ask({ kind: "tool", tool: tab.dataset.tool });
      };
    }
    const device = target.closest("g[data-device]")?.dataset.device;
    if (device && down !== undefined) {
      return () => ask(moves(Number(device), null, { by: [down, right] }));
    }
    if (device >= 0 && ["Delete", "Backspace"].includes(key))
      return () => ask({ kind: "remove", device: Number(device) });
    if (device >= 0 && key === "Enter" && state.tool === "channel")
      return () => ask({ kind: "look", device: Number(device) });
    if (target.matches(".map svg")) return overMap(key, down, right);
    const presses = key === " " && target.matches("button:not([role=tab])");
    const steer = tool().keys?.[key];
    if (!steer || presses) return null;
    return tab ? null : () => ask({ kind: "fly", action: steer });
  }

  /** The keys' pointer comes to a cell. */
  function pointAt([row, col]) {
    const svg = map();
    const { x: clientX, y: clientY } = new DOMPoint(col, row).matrixTransform(svg.getScreenCTM());
    svg.dispatchEvent(new PointerEvent("pointermove", { clientX, clientY, bubbles: true }));
  }
  let left = null; // where the keys' pointer was when it left the map
  el.addEventListener("focusin", ({ target }) => {
    const { devices, start } = stage.scene.state;
    if (target.matches(".map svg:focus-visible")) pointAt(stage.hovered ?? left ?? start);
    else if (target.matches(".map g[data-device]:focus-visible"))
      pointAt(devices[target.dataset.device]?.cell ?? start);
    if (target.matches(":focus-visible:not(.drawer *)")) find(".drawer").close();
  });
  el.addEventListener("focusout", ({ target, relatedTarget }) => {
    if (target.matches(".map svg")) left = stage.hovered;
    if (!target.closest(".map") || !relatedTarget || relatedTarget.closest(".map")) return;
    hover(null);
    map().dispatchEvent(new PointerEvent("pointerleave"));
  });

  /** Keys move a cell over the map; Enter and space do there what a press does. */
  function overMap(key, down, right) {
    const size = stage.scene.film.city.length;
    const [row, col] = stage.hovered ?? left ?? stage.scene.state.start;
    if (down !== undefined) {
      const inside = (axis) => Math.min(Math.max(axis, 0), size - 1);
      return () => pointAt([inside(row + down), inside(col + right)]);
    }
    if (key !== " " && key !== "Enter") return null;
    const thing = thingAt([row, col]);
    const { tool: name } = stage.scene.state;
    if (name === "channel" && thing !== null && thing >= 0)
      return () => ask({ kind: "look", device: thing });
    return name === "paint"
      ? () => ask({ kind: "paint", cells: [[row, col]], sign: brush.sign })
      : null;
  }

  // First of all, and whatever has the focus on a page of our own
  const press = (event) => {
    const { target, key, altKey } = event;
    if (altKey || !target.closest || (target !== document.body && !el.contains(target))) return;
    if (key === "Escape") {
      find(".drawer").close();
      stage.paint();
      return stage.endStory();
    }
    const undoes = event.ctrlKey || event.metaKey; // which a slider and a list leave to the page
    const writes = undoes ? "input:not([type=range], [type=checkbox])" : "input, select";
    const does_ = target.matches(writes) ? null : keyed(event);
    if (!does_) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    stage.endStory();
    does_();
  };
  window.addEventListener("keydown", press, true);
}
