// The stage: one page with the map, the controls and the panel of a tool. `paint` draws the scene
// that the session sent; whatever is done is told to the session, which answers with the next one.

import {
  CONTROLS,
  escaped,
  flightPanels,
  lastStep,
  legend,
  playback,
  showing,
  square,
} from "../player.js";
import { attend } from "./hands.js";
import { WORDS, button, options } from "./html.js";
import { brush } from "./paint.js";
import { linkOf } from "./state.js";
import { TOOLS } from "./tools.js";
import { LONGEST } from "./words.js";

const MORE = "Numbers and files";
const LINK = "stage=";
const LONG = ["many", "duel"]; // they show how far they are, and others do not wait for them
const SLOW = 300; // ms without an answer after which a word is due
const KEEP = 300; // ms from a change until the address says it
const STORY = [
  ["fly", "A drone collects data by radio, which buildings muffle. It must land on blue in time."],
  ["compare", "The orange flight goes to the nearest device; a neural network flies the blue one."],
  ["think", "Bars: what the network expects of each action. Take a device away: what changes?"],
  ["fly", "Your turn: beat the pale ghost, greedy. Later, train a network of your own."],
];

const page = (tools) => `<div class="main">
  <header><h1>uavdh_lite labs</h1><p>A drone collects data by radio and must be home in time.
    Beat a rule, question a neural network, train your own.</p></header>
  <div role="tablist" aria-label="tools" ${tools.length > 1 ? "" : "hidden"}>${tools.map(tab).join("")}</div>
  <div class="actions"><select data-set="city" aria-label="city"></select>
    ${button("New", { kind: "new" }, 'title="the next random mission; their order is the same for everybody"')}
    ${button("↶", { kind: "undo", by: -1 }, 'class="undo" aria-label="undo" title="undo the last change or move"')}
    ${button("↷", { kind: "undo", by: 1 }, 'class="redo" aria-label="redo" title="redo it"')}
    <button type="button" class="more" aria-haspopup="dialog" title="${MORE}">More</button></div>
  ${CONTROLS}
  <div class="stages"></div>
  <div class="tool" id="panel" role="tabpanel" tabindex="0"></div>
  <div class="caption" hidden><p class="told" role="status"></p>
    <div class="row"><button type="button" class="go">Next</button><button type="button" class="skip">End</button></div></div>
  <dialog class="drawer" aria-label="${MORE}">
    <form method="dialog"><h2>${MORE}</h2><button class="close" aria-label="close">×</button></form>
    <table class="devices"></table>
    <div class="row fields"></div>
    <div class="row">${button("Add a device", { kind: "add" }, 'class="add"')}</div>
    <div class="row">${button("Save", { kind: "save", what: "stage" })}
      ${button("Save only the mission", { kind: "save", what: "mission" })}
      <label class="file">Open <input type="file" accept=".json,.png,.safetensors"></label></div>
    <p>Open reads a saved page, a mission, a city's PNG or an agent's checkpoint; dropping the file onto the page does the
    same. The page's address opens this mission again. On the map, drag devices and the start; or press Tab and move them with the arrow keys; Delete removes a device.
    Among the tools, arrows choose a tab and Enter opens it.</p></dialog>
  <div class="notice refusal" role="alert"></div>
  <div class="notice busy" role="status" hidden><span></span><progress></progress>
    ${button("Cancel", { kind: "cancel" })}</div></div>`;
const tab = (tool) => `<button type="button" role="tab" id="tab-${tool}" data-tool="${tool}"
  aria-controls="panel">${TOOLS[tool].title}</button>`;

/**
 * Draws the stage in an element.
 * @param {HTMLElement} el
 * @param {object} model `send(told)` tells the session something; `hear(answer)` is set here and is
 *   called with what it answers: a scene, a file or progress
 */
export function draw(el, model) {
  const find = (selector) => el.querySelector(selector);
  let [scene, version, drawnTool, update] = [null, null, null, () => []];
  let [asked, waiting] = [0, []]; // how much was asked, what is not answered yet
  const next = new Map(); // what is asked when it has come, the last of each kind
  let [slow, refusing, keeping] = [null, null, null]; // timers
  let [clock, story] = [null, -1]; // the playback; the caption that is told, −1 for none
  let [opening, address] = [null, ""]; // the stage of the story; the address that was written
  el.classList.add("uavdh-player", "uavdh-stage");

  const stage = {
    el,
    find,
    get scene() {
      return scene;
    },
    hovered: null, // the cell under the pointer, or the keys'
    ask(told) {
      if (told.show !== undefined) return clock.show(told.show);
      if (told.kind === "tool") clock.show(clock.now.time); // pauses
      const step = shownStep(); // is told before
      if (step !== scene.state.step) next.set("show", { kind: "show", step });
      if (!told.quiet) stage.refuse("");
      askNext();
      send(told);
    },
    askWhenFree(told) {
      next.set(told.kind, told);
      if (!waiting.length) askNext();
    },
    /** Shows what was not done, until the next action, or for 8 seconds what was done. */
    refuse(text, done = false) {
      clearTimeout(refusing);
      find(".refusal").textContent = text;
      find(".refusal").classList.toggle("done", done);
      if (done) refusing = setTimeout(() => stage.refuse(""), 8000);
    },
    fill(selector, html) {
      const place = find(selector);
      if (!place || place.written === html) return;
      const open = [...place.querySelectorAll("details[open]")].map((each) => each.className);
      [place.written, place.innerHTML] = [html, html];
      for (const each of place.querySelectorAll("details"))
        each.open = open.includes(each.className);
    },
    /** Shifts the map to have a place in the middle of all that a network sees; null: as it is. */
    centre(place) {
      const svg = find(".map svg");
      const size = scene.film.city.length;
      svg.usual ??= svg.getAttribute("viewBox");
      const box = place && `${place[1] - size + 0.5} ${place[0] - size + 0.5}`;
      svg.setAttribute("viewBox", place ? `${box} ${2 * size - 1} ${2 * size - 1}` : svg.usual);
    },
    paint,
    point() {
      find(".cursor").setAttribute("d", stage.hovered ? square(stage.hovered) : "");
      TOOLS[scene.state.tool].point?.(stage, scene, stage.hovered);
    },
    /** Draws the cells of a stroke until the session has answered. */
    fresh() {
      const { cells, sign } = brush;
      const kind = `kind-${sign === "." ? "free" : sign}`;
      stage.fill(".fresh", `<path class="${kind}" d="${cells.map(square).join("")}"/>`);
    },
    get tells() {
      return opening !== null;
    },
    model,
    get clock() {
      return clock.now;
    },
    file: (told) => answers.file(told),
    tellStory() {
      const bytes = new TextEncoder().encode(JSON.stringify(opening));
      stage.ask({ kind: "open", file: { name: "", bytes }, story: true });
    },
    endStory,
    goOn: () => tell(story + 1),
    seek: (time) => clock.show(time),
  };

  function send(told) {
    told = { ...told, number: (asked += 1) };
    if (!LONG.includes(told.kind)) {
      waiting.push(told);
      find(".main").ariaBusy = true;
      clearTimeout(slow);
      const does = ["values", "why"].includes(told.kind) ? "Asking the network …" : "Flying …";
      slow = setTimeout(() => busy(does), SLOW);
    }
    model.send(told);
  }

  function askNext() {
    const all = [...next.values()];
    next.clear();
    all.forEach(send);
  }

  function busy(text, share) {
    if (!text && find(".busy").contains(document.activeElement))
      find("#panel").focus({ preventScroll: true });
    find(".busy").hidden = !text;
    find(".busy span").textContent = text;
    find(".busy progress").toggleAttribute("value", false);
    if (share !== undefined) find(".busy progress").value = share;
    find(".busy button").hidden = share === undefined;
  }

  /** @param {string} [done] what the scene answers */
  function paint(done) {
    const { state, film } = scene;
    const tool = TOOLS[state.tool];
    for (const each of el.querySelectorAll("[data-tool]")) {
      const on = each.dataset.tool === state.tool;
      each.setAttribute("aria-selected", on);
      each.tabIndex = on ? 0 : -1;
    }
    find(".main").dataset.shows = state.tool;
    find(".main").classList.remove("layered");
    find("#panel").setAttribute("aria-labelledby", `tab-${state.tool}`);
    const changed = version !== scene.version || drawnTool !== state.tool;
    const giveBack = heldFocus();
    if (changed) drawMaps(film, state.tool);
    if (drawnTool !== state.tool) find("#panel").scrollTop = 0;
    const words = (tool.words ?? []).map((word) => `<dt>${word}</dt><dd>${WORDS[word]}</dd>`);
    const [title, drawn] = tool.bare ? ["Words", ""] : ["Signs and words", legend(film)];
    const signs = `<details class="signs"><summary>${title}</summary>${drawn}<dl>${words.join("")}</dl></details>`;
    stage.fill(".tool", `${tool.html(scene, stage)}${signs}`);
    find(".map .under").innerHTML = tool.under?.(scene) ?? "";
    for (const over of el.querySelectorAll(".map .over"))
      over.innerHTML = `${tool.over?.(scene) ?? ""}<path class="cursor"/>`;
    const cities = state.cities.map((each) => [each, each]);
    find("[data-set=city]").innerHTML = options(cities, state.city);
    find(".undo").disabled = !state.undo;
    find(".redo").disabled = !state.redo;
    paintDrawer();
    const fly = state.tool === "fly"; // flies the last step
    const flown = film.flights[0].path.length - 1;
    const rests = tool.begins ? 0 : lastStep(film);
    const last = fly && !scene.panel.you.ended ? flown : lastStep(film); // the ghost flies on
    if (changed) {
      const flies = fly && done === "fly" && flown > clock.now.last;
      clock.load(last, flies ? flown - 1 : fly ? last : state.step < 0 ? rests : state.step, flies);
    } else clock.show(clock.now.time, clock.now.playing);
    [version, drawnTool] = [scene.version, state.tool];
    if (stage.hovered && !film.city[stage.hovered[0]]?.[stage.hovered[1]]) stage.hovered = null;
    stage.point();
    giveBack();
  }

  function drawMaps(film, tool) {
    const shown = { ...film, flights: film.flights.slice(0, TOOLS[tool].maps ?? 1) };
    const still = Boolean(TOOLS[tool].still?.(scene));
    if (still) shown.flights = shown.flights.map(atStart);
    el.classList.toggle("still", still);
    find(".stages").innerHTML = flightPanels(shown);
    update = showing(find(".flights"), shown);
    find(".flight + .flight")?.toggleAttribute("inert", true); // what is moved is moved on the first
    const cursor = TOOLS[tool].cursor;
    const map = find(".map svg");
    map.setAttribute("role", cursor ? "application" : "group");
    if (cursor) {
      if (tool === "paint") map.nextElementSibling.setAttribute("aria-live", "polite");
      map.setAttribute("tabindex", "0");
      map.setAttribute("aria-label", `map: ${cursor}`);
    }
    find(".map g:has(> g > .start)").dataset.device = -1;
    for (const thing of el.querySelectorAll(".map g[data-device]")) {
      const k = Number(thing.dataset.device);
      const [name, [row, col]] =
        k < 0 ? ["start", scene.state.start] : [`device ${k}`, film.devices[k].cell];
      thing.setAttribute("tabindex", "0");
      thing.setAttribute("role", "button");
      thing.setAttribute("aria-label", `${name}, row ${row}, column ${col}; arrows move it`);
    }
  }

  /** A flight that has not begun, where none is shown. */
  const atStart = ({ name, path: [start], left: [all] }) => ({
    name,
    path: [start],
    left: [all],
    refused: [],
    end: "in the air",
    ending: "",
  });

  /** A function that gives the focus back to what has taken its place, or to the panel. */
  function heldFocus() {
    const focused = el.contains(document.activeElement) ? document.activeElement : null;
    if (!focused) return () => {};
    const attribute = ([name, value]) => `[data-${name}="${CSS.escape(value)}"]`;
    const places = Object.entries(focused.dataset).map(attribute);
    const where = focused.closest("svg") ? "svg " : focused.closest(".side") ? ".side " : "";
    const own = focused.classList[0] ? `.${focused.classList[0]}` : "#panel";
    const same = focused.matches(".map svg") ? ".map svg" : where + (places.join("") || own);
    const lost = () => !el.contains(document.activeElement) || document.activeElement.disabled;
    const or = focused.closest(".drawer") ? ".add" : "#panel";
    return () => {
      for (const each of [same, own, or]) if (lost()) find(each)?.focus({ preventScroll: true });
    };
  }

  function paintDrawer() {
    const { state } = scene;
    const full = state.devices.length >= state.most;
    const field = (name, label, value, limits) =>
      `<label>${label} <input type="number" data-field="${name}" value="${value}" required ${limits}></label>`;
    const row = (
      { data },
      k,
    ) => `<tr><th>device ${k}</th><td>${field(`data ${k}`, "data", data, 'min="0" max="32767" step="any"')}</td>
      <td>${button("×", { kind: "remove", device: k }, `aria-label="remove device ${k}" title="remove"`)}</td></tr>`;
    stage.fill(".devices", state.devices.map(row).join(""));
    const limits = `min="1" max="${LONGEST}"`;
    stage.fill(".fields", field("time", "flying time", state.flyingTime, limits));
    find(".add").disabled = full;
  }

  /** The step that is shown, −1 for the last. */
  function shownStep() {
    const { time, last } = clock.now;
    return scene.state.tool === "fly" ? scene.state.step : time === last ? -1 : Math.floor(time);
  }

  const stageNow = () => ({ ...scene.stage, step: shownStep() });

  /** The page's address says what it shows, so that a reload shows it again. */
  async function keep() {
    keeping = null;
    const link = `#${LINK}${await linkOf(stageNow())}`;
    if (story >= 0 || link === address || waiting.some(({ kind }) => kind === "open")) return;
    history.replaceState(null, "", link);
    address = link;
  }

  function tell(caption) {
    if (caption >= STORY.length) return endStory();
    story = caption;
    const [tool, text] = STORY[story];
    stage.ask({ kind: "tool", tool, story: tool !== "fly" });
    find(".main").scrollTop = 0; // on a phone
    find(".caption").hidden = false;
    find(".told").textContent = text;
    find(".go").textContent = story === STORY.length - 1 ? "Fly" : "Next";
    find(".go").focus({ preventScroll: true });
  }

  function endStory() {
    if (story < 0) return;
    const held = find(".caption").contains(document.activeElement);
    [story, find(".caption").hidden] = [-1, true];
    if (held) find("#panel").focus({ preventScroll: true });
  }

  /** Opens what an address says. */
  function openLink(hash) {
    const link = hash.split(LINK)[1];
    if (link) stage.ask({ kind: "open", link });
  }

  const answers = {
    scene(told) {
      const first = !scene;
      ({ scene } = told);
      if (first) return begin();
      const answer = scene.refused
        ? {}
        : (waiting.find(({ number }) => number === scene.number) ?? {});
      const answered = answer.kind;
      if (answered === "open") find(".drawer").close();
      waiting = waiting.filter(({ number }) => number !== scene.number);
      if (!waiting.length) {
        clearTimeout(slow);
        if (!scene.working) busy("");
      }
      if (scene.refused) stage.refuse(scene.refused);
      else if (scene.note || !scene.quiet) stage.refuse(scene.note, true);
      if (brush.cells) return; // a stroke is drawn until it is over
      if (!waiting.length) askNext(); // it is computed while this is drawn
      paint(answered);
      if (answered === "open" && answer.story) tell(0);
      else if (answer.story) clock.show(0, true);
      if (waiting.length) return;
      find(".main").ariaBusy = false;
    },
    progress({ text, share }) {
      if (text || (share === undefined && !waiting.length)) busy(text, share);
    },
    file({ name, content }) {
      const href = URL.createObjectURL(new Blob([content]));
      Object.assign(document.createElement("a"), { href, download: name }).click();
      setTimeout(() => URL.revokeObjectURL(href), 10_000);
      stage.refuse(`Saved as ${name}.`, true);
    },
  };
  model.hear = (told) => answers[told.kind](told);

  function begin() {
    el.innerHTML = page(scene.tools);
    if (scene.fresh) opening = scene.stage;
    el.tabIndex = -1; // a press beside everything leaves the keys here
    attend(stage); // before the playback, so that it hears of keys first
    clock = playback(el, (time, playing) => {
      const texts = update(time, playing);
      TOOLS[scene.state.tool].moment?.(stage, scene, time, playing);
      if (model.own) keeping ??= setTimeout(keep, KEEP);
      return texts;
    });
    paint();
    if (!model.own) return;
    const open = () => location.hash && location.hash !== address && openLink(location.hash);
    window.addEventListener("hashchange", open);
    open();
  }
}
