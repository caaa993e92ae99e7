// The stage: one page with the map, the controls and the panel of a tool. `paint` draws what the
// session sent, the scene; whatever is done is told to the session, which answers with the next scene.

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
import { linkOf } from "./state.js";
import { TOOLS, brush, button, options } from "./tools.js";
import { LONGEST } from "./words.js";

const MORE = "Cells, numbers and files";
const LINK = "stage=";
const LONG = ["many", "duel"]; // they show how far they are, and others do not wait for them
const SLOW = 300; // ms without an answer after which a word is due
const KEEP = 200; // ms from a change until the browser keeps it
const LEFT = "uavdh_lite: left"; // the key of the state in which the page was left
const BURST = 400; // ms between changes that are one entry of the browser's history
const FULL = `<svg viewBox="0 0 16 16" width="16" aria-hidden="true"><path d="M1 6V1h5M10 1h5v5M15 10v5h-5M6 15H1v-5"/></svg>`;

const page = (tools) => `<h1>uavdh_lite labs</h1><div class="top">
    <div role="tablist" aria-label="tools" ${tools.length > 1 ? "" : "hidden"}>${tools.map(tab).join("")}</div>
    ${CONTROLS}
    <div class="actions">
      <select data-set="city" aria-label="city"></select>
      ${button("New", { kind: "new" }, 'title="the next random mission; their order is the same for everybody"')}
      ${button("↶", { kind: "undo", by: -1 }, 'class="undo" aria-label="undo" title="undo the last change; in Fly, the last move"')}
      ${button("↷", { kind: "undo", by: 1 }, 'class="redo" aria-label="redo" title="redo it"')}
      <button type="button" class="copy" data-name="Link">Link</button>
      <button type="button" class="more" aria-haspopup="dialog" title="${MORE}">More</button>
      <button type="button" class="full" aria-label="full screen">${FULL}</button>
    </div></div>
  <div class="main"><div class="inside"><div class="stages"></div>
    <div class="tool" id="panel" role="tabpanel" tabindex="0"></div>
    <div class="caption" hidden><div class="told" role="status"></div>
      <div class="row"><button type="button" class="go"></button><button type="button" class="skip">Skip the story</button></div></div></div>
    <dialog class="drawer" aria-label="${MORE}">
      <form method="dialog"><h2>${MORE}</h2><button class="close" aria-label="close">×</button></form>
      <table class="devices"></table>
      <div class="row fields"></div>
      <div class="row"><button type="button" data-set="place">Add a device</button><span class="hint" role="status"></span></div>
      <div class="row">${button("Save", { kind: "save", what: "stage" })}
        ${button("Save the mission alone", { kind: "save", what: "mission" })}
        <label class="file">Open <input type="file" accept=".json,.png,.safetensors"></label>
        <label>or a link <input type="text" data-set="link" placeholder="…#${LINK}…"></label>
        <button type="button" class="copy" data-name="Copy the link">Copy the link</button></div>
      <p>Save keeps the city, the mission and all that is chosen here in a file; the mission alone has neither rivals nor
      step. Open reads such a file, a mission, a city's PNG or an agent's checkpoint; dropping the file onto the page does the same. On the map, drag devices and the start; or press Tab
      and move them with the arrow keys; Delete removes a device.</p></dialog>
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
  let [scene, past, version, drawnTool, update] = [null, null, null, null, () => []];
  let [asked, waiting, settle] = [0, [], () => {}]; // how much was asked, what is not answered yet, what is called when all is
  const next = new Map(); // what is asked when it has come, the last of each kind
  let [slow, refusing, keeping] = [null, null, null]; // timers: of a word, of what is shown as not done, of what is to be kept
  let [clock, story] = [null, false]; // the playback; whether the story is told
  let opening = null; // the stage that the story is about, where the page has one
  let again = []; // what had no answer before a reload
  let entry = {}; // of the browser's history: its text, its place and when it was new; empty while another is opened
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
    /** Shows until the next action that something was not done, or for 8 seconds at most what was done. */
    refuse(text, done = false) {
      clearTimeout(refusing);
      find(".refusal").textContent = text;
      find(".refusal").classList.toggle("done", done);
      if (done) refusing = setTimeout(() => stage.refuse(""), 8000);
    },
    fill(selector, html) {
      const place = find(selector);
      if (!place || place.written === html) return;
      [place.written, place.innerHTML] = [html, html];
      const words = new Set(); // those that Tab has come to: each explains itself once
      for (const term of el.querySelectorAll(".tool .term")) {
        term.tabIndex = words.has(term.ariaLabel) ? -1 : 0;
        words.add(term.ariaLabel);
      }
    },
    /** Shifts the map so that a place is in the middle of all that a network sees; null: as it is. */
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
    /** Draws cells as painted until the session has answered. */
    fresh() {
      const strokes = [
        ...waiting.filter(({ kind }) => kind === "paint"),
        ...(brush.cells ? [brush] : []),
      ];
      const drawn = ({ cells, sign }) =>
        `<path class="kind-${sign === "." ? "free" : sign}" d="${cells.map(square).join("")}"/>`;
      stage.fill(".fresh", strokes.map(drawn).join(""));
    },
    get tells() {
      return opening !== null;
    },
    tellStory: () =>
      stage.ask({ kind: "open", file: new File([JSON.stringify(opening)], ""), story: true }),
    endStory,
    goOn() {
      const { time, last } = clock.now;
      if (time >= last) endStory();
      else clock.show(time, true);
    },
    skipStory() {
      endStory();
      clock.show(clock.now.last);
    },
    async copyLink(button) {
      const answered = new Promise((resolve) => (waiting.length ? (settle = resolve) : resolve()));
      const text = answered
        .then(() => linkOf(stageNow()))
        .then((link) => `${location.href.split("#")[0]}#${LINK}${link}`);
      try {
        const blob = text.then((content) => new Blob([content], { type: "text/plain" }));
        await navigator.clipboard.write([new ClipboardItem({ "text/plain": blob })]); // promised during the press
        button.textContent = "Copied";
        if (location.protocol === "file:")
          stage.refuse(
            "Whoever opens the link needs this file, too: open it, press More and paste the link.",
            true,
          );
        setTimeout(() => (button.textContent = button.dataset.name), 1500);
      } catch {
        find(".drawer").show();
        find("[data-set=link]").value = await text;
        find("[data-set=link]").select();
        stage.refuse(
          "Not copied, because the browser does not allow it here: copy the link from its field.",
        );
      }
    },
    /** Opens a link's part of an address, or a text that ends with it; `here` if the address is there already. */
    openLink(text, here = false) {
      const there = text.split(LINK)[1]?.replace(/%..|[^\w-]/g, ""); // a mail adds full stops, quotes and line breaks
      if (there) stage.ask({ kind: "open", link: there, here });
      else if (text)
        stage.refuse(
          `Not done: ${here ? "this address" : "this"} is not a link to a page of the labs, which has letters after #${LINK}.`,
        );
      return Boolean(there);
    },
  };

  function send(told) {
    told = { ...told, number: (asked += 1) };
    if (!LONG.includes(told.kind)) {
      waiting.push(told);
      if (told.kind === "paint") stage.fresh();
      clearTimeout(slow);
      slow = setTimeout(
        () => busy(told.kind === "values" ? "Working out the value of each cell …" : "Flying …"),
        SLOW,
      );
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
    find(".main").classList.remove("layered", "seen");
    find("#panel").setAttribute("aria-labelledby", `tab-${state.tool}`);
    const changed = version !== scene.version || drawnTool !== state.tool;
    const giveBack = heldFocus();
    if (changed) drawMaps(film, state.tool);
    const warnings = scene.warnings
      .map((text) => `<p class="warning">${escaped(text)}</p>`)
      .join("");
    const place = scene.place ? `<p class="place"><small>${escaped(scene.place)}</small></p>` : "";
    const other = drawnTool !== state.tool || (changed && state.tool === "compare"); // its verdict comes first
    if (other) find("#panel").scrollTop = find(".inside").scrollTop = 0;
    stage.fill(".tool", `${tool.html(scene, stage)}${warnings}${place}${legend(film)}`);
    el.querySelectorAll(".map svg").forEach((map, k) => {
      map.querySelector(".under").innerHTML = tool.under?.(scene, k) ?? "";
      map.querySelector(".over").innerHTML = `${tool.over?.(scene, k) ?? ""}<path class="cursor"/>`;
    });
    find("[data-set=city]").innerHTML = options(
      state.cities.map((each) => [each, each]),
      state.city,
    );
    find(".undo").disabled = !state.undo;
    find(".redo").disabled = !state.redo;
    paintDrawer();
    const fly = state.tool === "fly"; // shows the last step, and flies it; the others know their step
    const flown = film.flights[0].path.length - 1;
    const last = fly && !scene.panel.you.ended ? flown : lastStep(film); // the ghost flies on to its end
    if (changed) {
      const flies = fly && done === "fly" && flown > clock.now.last;
      clock.load(last, flies ? flown - 1 : fly || state.step < 0 ? last : state.step, flies);
    } else clock.show(clock.now.time, clock.now.playing);
    [version, drawnTool] = [scene.version, state.tool];
    if (stage.hovered && !film.city[stage.hovered[0]]?.[stage.hovered[1]]) stage.hovered = null;
    stage.point();
    stage.fresh();
    giveBack();
  }

  function drawMaps(film, tool) {
    const shown = tool === "compare" ? film : { ...film, flights: film.flights.slice(0, 1) };
    const still = Boolean(TOOLS[tool].still?.(scene));
    if (still) shown.flights = shown.flights.map(atStart);
    el.classList.toggle("still", still);
    find(".stages").innerHTML = flightPanels(shown);
    update = showing(find(".flights"), shown);
    const cursor = TOOLS[tool].cursor;
    for (const map of el.querySelectorAll(".map svg")) {
      map.setAttribute("role", cursor ? "application" : "group");
      if (!cursor) continue;
      if (tool === "paint") map.nextElementSibling.setAttribute("aria-live", "polite"); // Channel has its sentence
      map.setAttribute("tabindex", "0");
      map.setAttribute("aria-label", `map: ${cursor}`);
    }
    for (const start of el.querySelectorAll(".map g:has(> g > .start)")) start.dataset.device = -1;
    for (const bar of el.querySelectorAll(".flight ~ .flight .bar"))
      bar.removeAttribute("tabindex"); // the first map's do the same
    for (const thing of el.querySelectorAll(".map g[data-device]")) {
      const k = Number(thing.dataset.device);
      const [name, [row, col]] =
        k < 0 ? ["start", scene.state.start] : [`device ${k}`, film.devices[k].cell];
      thing.setAttribute("tabindex", thing.closest(".flight ~ .flight") ? "-1" : "0");
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
    const { device, ask: asks, set, sign, field } = focused?.dataset ?? {};
    const named = { device, ask: asks, set, sign, field };
    const [name, value] = Object.entries(named).find(([, each]) => each !== undefined) ?? [];
    const map = focused?.matches(".map svg");
    const inDrawer = focused?.closest(".drawer");
    const where = focused?.closest("svg") ? "svg " : focused?.closest(".side") ? ".side " : "";
    const lost = () => !el.contains(document.activeElement) || document.activeElement.disabled;
    return () => {
      if (!focused || !lost()) return;
      const same = map
        ? ".map svg"
        : name
          ? `${where}[data-${name}="${CSS.escape(value)}"]`
          : `.${focused.classList[0]}`;
      if (same !== ".undefined") find(same)?.focus({ preventScroll: true });
      if (lost() && inDrawer) find("[data-set=place]").focus(); // what had it was removed
      if (lost()) find("#panel").focus({ preventScroll: true });
    };
  }

  function paintDrawer() {
    const { state } = scene;
    const full = state.devices.length >= state.most;
    const adding = el.classList.contains("adding") && !full;
    const field = (name, label, value, limits) =>
      `<label>${label} <input type="number" data-field="${name}" value="${value}" required ${limits}></label>`;
    const axis = `min="0" max="${scene.film.city.length - 1}"`;
    const place = (device, [row, col]) =>
      `<td>${field(`row ${device}`, "row", row, axis)}</td><td>${field(`col ${device}`, "column", col, axis)}</td>`;
    const row = ({ cell, data }, k) => `<tr><th>device ${k}</th>${place(k, cell)}
      <td>${field(`data ${k}`, "data", data, 'min="0" max="32767" step="any"')}</td>
      <td>${button("×", { kind: "remove", device: k }, `aria-label="remove device ${k}" title="remove"`)}</td></tr>`;
    stage.fill(
      ".devices",
      `${state.devices.map(row).join("")}<tr><th>start</th>${place(-1, state.start)}</tr>`,
    );
    stage.fill(
      ".fields",
      field("time", "flying time", state.flyingTime, `min="1" max="${LONGEST}"`),
    );
    find("[data-set=place]").setAttribute("aria-pressed", adding);
    find("[data-set=place]").disabled = full;
    stage.fill(
      ".hint",
      full ? `at most ${state.most} devices here` : adding ? "Press a free cell on the map." : "",
    );
  }

  // What the browser keeps, for a reload, for back and forward, and as the page's address

  /** The step that is shown, −1 for the last. */
  function shownStep() {
    const { time, last } = clock.now;
    if (story || scene.state.tool === "fly") return scene.state.step;
    return time === last ? -1 : Math.floor(time);
  }

  const stageNow = () => ({ ...scene.stage, step: shownStep() });
  const stateNow = () => {
    const asks = [...waiting, ...again, ...next.values()];
    return {
      stage: stageNow(),
      asks,
      sign: brush.sign,
      story: story && { step: Math.floor(clock.now.time) },
    };
  };
  const placeOf = ({ mission, tool }) => JSON.stringify([mission, tool]); // another is another entry
  const opens = () => waiting.some(({ kind }) => kind === "open"); // then this entry is not ours to write

  async function keep() {
    keeping = null;
    const text = JSON.stringify(stateNow());
    if (text === entry.text) return;
    const link = await linkOf(stageNow());
    if (opens()) return;
    const [state, address, now] = [stateNow(), story ? null : `#${LINK}${link}`, performance.now()]; // never an older state than is kept
    const place = placeOf(state.stage);
    const moved = Boolean(entry.place) && place !== entry.place;
    history[moved && now - entry.since > BURST ? "pushState" : "replaceState"](state, "", address);
    entry = { text, place, since: moved ? now : (entry.since ?? -BURST) };
  }

  /** When the page is left, there is no time for the address, and a reload ignores what its history is told then. */
  function keepNow() {
    if (opens()) return;
    const state = stateNow();
    history.replaceState(state, "");
    try {
      sessionStorage.setItem(LEFT, JSON.stringify({ ...state, past }));
    } catch {} // a frame may not have it
  }

  /** The state in which the page was left, if this is a reload; else what its history has. */
  function stateBefore() {
    try {
      const reloads = performance.getEntriesByType("navigation")[0].type === "reload";
      if (reloads) return JSON.parse(sessionStorage.getItem(LEFT)) ?? history.state;
    } catch {}
    return history.state;
  }

  /** Opens what an entry of the browser's history has, its state or its address; says whether there is something. */
  function openEntry(state) {
    entry = state?.stage ? { place: placeOf(state.stage), since: -BURST } : {}; // what is done next is another
    if (!state?.stage) return stage.openLink(location.hash, true);
    stage.ask({
      kind: "open",
      file: new File([JSON.stringify(state.stage)], ""),
      here: true,
      past: state.past,
    });
    return true;
  }

  // The story: a duel plays, and captions say what to look at

  function beginStory({ step } = { step: 0 }) {
    if (!opening || scene.state.tool !== "compare") return;
    story = true;
    el.classList.add("telling");
    clock.show(step);
    find(".go").focus({ preventScroll: true });
    stage.ask({ kind: "many", quiet: true });
  }

  function captions() {
    const { parting, why, verdict, results, many } = scene.panel;
    const home = many?.map(({ who, both }) => `${who.subject} brings ${both[0]} %`).join(" and ");
    const [other, lead] = many ? [many[1].who.subject, many[1].both[0] - many[0].both[0]] : []; // the first wins this mission
    const often = home
      ? ` Over 100 random missions, ${home} of the data home${lead > 0 ? `, so on average ${other} is ahead` : ""}.`
      : "";
    return [
      [
        0,
        "Two drones, one mission: collect the devices' data, and land on a blue cell in time.",
        "Grey: tall buildings. Red lines: no-fly zone. Violet: hidden from the device that is heard.",
      ],
      [parting ?? 0, `Here they part for good. ${[why[0], ...why.slice(1).slice(-1)].join(" ")}`],
      [
        Math.max(...results.map(({ steps }) => steps)),
        `${verdict} This mission was chosen because the difference shows.${often} Now it is your turn: drag a device, or fly yourself.`,
      ],
    ];
  }

  function tellStory(time, playing) {
    if (!story) return;
    const [, text, about = ""] = captions()
      .filter(([from]) => from <= time)
      .at(-1);
    const [caption, told, go, skip] = [".caption", ".told", ".go", ".skip"].map(find);
    const end = time >= clock.now.last;
    caption.hidden = false;
    go.textContent = end ? "Your turn" : "Go on";
    go.ariaDisabled = playing; // it keeps its place and the focus, and another press does nothing
    if (end && document.activeElement === skip) go.focus({ preventScroll: true });
    skip.hidden = end;
    if (told.dataset.text === text) return;
    told.dataset.text = text;
    told.innerHTML = `<p>${escaped(text)}</p><p><small>${about} Orange ring: where each is before they part for good.</small></p>`;
    told.scrollTop = 0;
    if (playing) setTimeout(() => clock.show(Math.floor(time))); // to be read; between two steps the counter is already at the next
  }

  function endStory() {
    if (!story) return;
    const held = find(".caption").contains(document.activeElement);
    [story, find(".caption").hidden] = [false, true];
    el.classList.remove("telling");
    if (held) find("#panel").focus({ preventScroll: true });
  }

  // What the session answers

  const answers = {
    scene(told) {
      const first = !scene;
      ({ scene } = told);
      past = scene.past ?? past; // is told when it has changed
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
      if (answer.story) beginStory();
      if (answered === "race") clock.show(0, true);
      if (!waiting.length && again.length) stage.ask(again.shift());
      if (!waiting.length) settle();
    },
    progress({ text, share }) {
      if (text || (share === undefined && !waiting.length)) busy(text, share);
    },
    file({ name, blob }) {
      const href = URL.createObjectURL(blob);
      Object.assign(document.createElement("a"), { href, download: name }).click();
      setTimeout(() => URL.revokeObjectURL(href), 10_000);
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
      tellStory(time, playing);
      if (model.own) keeping ??= setTimeout(keep, KEEP);
      return texts;
    });
    for (const copy of el.querySelectorAll(".copy")) copy.hidden = !model.own;
    find(".full").hidden = !document.fullscreenEnabled;
    paint();
    if (!model.own) return beginStory();
    window.addEventListener("popstate", ({ state }) => {
      try {
        sessionStorage.removeItem(LEFT); // which is older
      } catch {}
      openEntry(state);
    });
    window.addEventListener("pagehide", keepNow);
    document.addEventListener("visibilitychange", keepNow);
    const before = stateBefore();
    const { story: told, asks = [], sign } = before ?? {};
    brush.sign = sign ?? brush.sign;
    if (told) return beginStory(told);
    again = asks;
    if (!openEntry(before)) beginStory();
  }
}
