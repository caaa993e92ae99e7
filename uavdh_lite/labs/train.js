// Train: DDQN learns while one looks and turns its dials. Up to two runs learn beside each other,
// each in a worker; the session flies their agents of now.

import { at, escaped } from "../player.js";
import { DIAL_WORDS, valued } from "./html.js";
import { rose } from "./think.js";
import { ANEW } from "./training.js";
import { grouped } from "./words.js";

const RUNS = ["blue", "orange"];
const LARGEST = 8; // cells on a side of the cities in which it learns
const PAST = 8; // earlier runs whose curves stay, faint
const PATIENCE = 300; // s of learning from which on a device is called slow
const IN_PLACE = { observation: "non_centred" };
const SCALES = { data_scale: 20, time_scale: 10 };
const crash = (crash_reward, crash_reward_end = null) => ({ crash_reward, crash_reward_end });
const FREE = { ...crash(0), movement_reward: 0 };
const each = (field, ...values) =>
  values.map((value) => [value < 1000 ? `${value}` : grouped(value), { [field]: value }]);

const stops = (...all) => all.flatMap((text, k) => (k % 2 ? [] : [[text, all[k + 1]]]));
const toggle = (off, on) => stops("off", off, "on", on);
const target = (text, target_update_rate, frozen = false) => [text, { target_update_rate, frozen }];

/** The dials: each has stops, with what it says there and the fields that it sets. */
const DIALS = {
  "learning rate": each("learning_rate", 0.0001, 0.0005, 0.001, 0.002, 0.005, 0.01),
  "discount γ": each("discount", 0, 0.5, 0.8, 0.9, 0.95, 0.99, 1),
  "crash costs": stops("0", crash(0), "5–20", crash(-5, -20), "20", crash(-20), "150", crash(-150)),
  "exploration β": each("temperature", 0.01, 0.03, 0.1, 0.3, 1, 3),
  target: stops("single", { double: false }, "double", { double: true }),
  "target rate τ": [
    target("frozen", 0.005, true),
    ...[0.0005, 0.005, 0.05, 1].map((rate) => target(`${rate}`, rate)),
  ],
  memory: each("replay_capacity", 64, 1000, 10_000, 40_000),
  "return steps": each("return_steps", 1, 2, 3, 5, 10),
  map: stops("in place", IN_PLACE, "centred", { observation: "centred" }),
  "input scales": toggle({ data_scale: 1, time_scale: 1 }, SCALES),
  "layer norm": toggle({ layer_norm: false }, { layer_norm: true }),
  steps: each("steps", 6000, 48_000, 144_000),
  seed: each("seed", 0, 1, 2, 3, 4, 5, 6, 7, 8, 9),
};

/** Things to try: how the two runs differ from the usual one, and what differs in words. */
const TRIES = {
  "frozen target": [{}, { frozen: true }, "The target stands still."],
  "no punishment": [{}, FREE, "Crashes and steps cost orange nothing; the return counts them."],
  "memory of 64": [{}, { replay_capacity: 64 }, "Orange remembers four steps a UAV."],
  "not centred": [{}, IN_PLACE, "Orange sees the map in place."],
  "not centred, scaled": [SCALES, { ...IN_PLACE, ...SCALES }, "The same, with input scales."],
  "γ 0.5": [{}, { discount: 0.5 }, "Orange halves rewards with each step."],
};

const share = (value) => `${Math.round(100 * value)} %`;
/** What the curves show of a point, from where, up to where at least, and how it is written. */
const CURVES = {
  landed: [(point) => point.landed, 0, 1, share],
  collected: [(point) => point.collected, 0, 1, share],
  return: [(point) => point.return, -60, 10, (value) => value.toFixed(1).replace("-", "−")],
  loss: [(point) => point.loss, 0, 1, (value) => value.toFixed(value < 10 ? 2 : 0)],
};

const runs = []; // those that learn: dials, points, worker and what it told last
let past = []; // earlier runs in the same city
const BEGIN = "Press Learn: a network learns, and 50 missions judge it.";
let bench = null; // the panel's content, which keeps its focus while the panel is written anew
let [stage, chosen, told, wanted, asked] = [null, 0, BEGIN, null, 0];
let drawn = ["", ""]; // under and over the map, until they are known anew

const OWN = { double: true, frozen: false, seed: 0, steps: 48_000 }; // what the recipe has not
const usual = () => ({ ...stage.model.recipe, ...OWN });
const stopOf = (all, dials) =>
  all.findIndex(([, fields]) =>
    Object.entries(fields).every(([name, value]) => dials[name] === value),
  );
const textOf = (name, dials) => DIALS[name][stopOf(DIALS[name], dials)]?.[0] ?? "?";

/** Begins a run in place of the one with the same number, where another is or in the city shown. */
function begin(number, dials, goes, { city, scenario } = stage.scene.panel) {
  end(number);
  past = past.filter((each) => String(each.city.rows) === String(city.rows)).slice(0, PAST);
  const run = { dials, city, scenario, points: [], steps: 0, goes, going: goes, rate: 0 };
  runs[number] = run;
  run.worker = stage.model.begin("run", { city, scenario, dials }, (answer) => hear(run, answer));
  if (goes) run.worker.send({ kind: "go" });
}

function end(number) {
  const run = runs[number];
  if (!run) return;
  run.worker.end();
  if (run.points.length > 1) past.unshift(run);
}

function hear(run, { kind, bytes, points, ...answer }) {
  if (!runs.includes(run)) return;
  if (kind === "file") {
    return stage.file({ name: `${run.city.name}_agent.safetensors`, content: bytes });
  }
  run.points.push(...points);
  Object.assign(run, answer);
  draw();
  offer();
}

/** Gives the session the agents of now, so that they fly; not while those before are watched. */
function offer() {
  const run = runs[chosen];
  if (!run?.agent || stage.clock.playing || (stage.scene.state.tool !== "train" && run.going))
    return;
  if (performance.now() - asked < 2000) return; // until it has answered
  asked = performance.now();
  const agents = runs.map(({ agent }, number) => [number, agent]);
  const step = Math.floor(stage.clock.time);
  stage.model.send({ kind: "learned", which: chosen, agents, step, quiet: true });
  for (const each of runs) each.agent = null;
}

const doAll = (kind) => {
  for (const run of runs) run.worker.send({ kind });
};

/** Turns a dial of the chosen run; where that gives another network, it begins anew. */
function turn(name, place) {
  const fields = DIALS[name][place][1];
  const run = runs[chosen];
  if (!run) return start(() => begin(0, { ...usual(), ...fields }, false));
  const dials = { ...run.dials, ...fields };
  if (Object.keys(fields).some((field) => ANEW.includes(field))) {
    begin(chosen, dials, run.going || (run.goes && !run.steps), run); // though it told nothing yet
    told = `New run: ${name} ${textOf(name, dials)}.`;
  } else {
    run.dials = dials;
    run.worker.send({ kind: "turn", dials: fields });
  }
  draw();
}

const acts = {
  learn() {
    if (!runs.length) return start(() => begin(0, usual(), true));
    const over = runs.every(({ steps, dials }) => steps >= dials.steps);
    if (over) told = "This run is over: press Restart, or turn steps up.";
    const goes = runs.some(({ going }) => going);
    doAll(goes ? "stop" : "go");
  },
  step: () =>
    start(() => {
      if (!runs.length) begin(0, usual(), false);
      doAll("step");
    }),
  anew() {
    const goes = runs.some(({ going }) => going);
    const next = (dials) => ({ ...dials, seed: (dials.seed + 1) % DIALS.seed.length });
    start(() => runs.forEach(({ dials }, number) => begin(number, next(dials), goes)));
    told = `New runs with the next seed, ${runs[0].dials.seed}.`;
  },
  second() {
    if (runs.length > 1) {
      end(1);
      runs.pop();
      chosen = 0;
    } else begin((chosen = 1), { ...runs[0].dials }, true, runs[0]);
    offer();
  },
  choose: (number) => {
    chosen = Number(number);
    runs[chosen].worker.send({ kind: runs[chosen].going ? "go" : "stop" }); // tells its agent
  },
  try(name) {
    const [first, second, says] = TRIES[name];
    start(() =>
      [first, second].forEach((dials, number) => begin(number, { ...usual(), ...dials }, true)),
    );
    [told, chosen] = [says, 1];
  },
  save: () => runs[chosen].worker.send({ kind: "save" }),
  take() {
    runs[chosen].points = []; // its own way there is not known
    runs[chosen].worker.send({ kind: "take", base64: stage.model.trained });
  },
};

/** Does something in a city that is small enough: the one that is shown, or the village. */
function start(act) {
  if (stage.scene.panel.city.rows.length <= LARGEST) return act();
  wanted = act;
  told = "Over the village, because this city is too large.";
  stage.ask({ kind: "city", name: "village" });
}

function press({ target }) {
  const { act, about } = target.closest("[data-act]")?.dataset ?? {};
  if (!act) return;
  told = "";
  acts[act](about);
  draw();
}

const key = (act, name, about = "") =>
  `<button type="button" data-act="${act}" data-about="${about}">${name}</button>`;

function frame() {
  const dial = ([name, stops], k) => {
    const anew = Object.keys(stops[0][1]).some((field) => ANEW.includes(field));
    return `<label class="dial"><span>${name}${anew ? " ↻" : ""}</span><input type="range" min="0" max="${stops.length - 1}"
      data-dial="${name}" aria-label="${name}${anew ? ", begins anew" : ""}"><output></output></label>`;
  };
  bench = document.createElement("div");
  bench.addEventListener("click", press);
  bench.addEventListener("input", ({ target }) => turn(target.dataset.dial, Number(target.value)));
  const tries = Object.keys(TRIES).map((name) => key("try", name, name));
  const dials = Object.entries(DIALS).map(dial);
  bench.innerHTML = `<div class="row acts">${key("learn", "Learn")}${key("step", "Step")}${key("anew", "Restart")}
      ${key("second", "Two runs")}${key("save", "Save")}</div>
    <div class="row tries"><span>Try</span>${tries.join("")}</div><p class="word" role="status"></p>
    <div class="runs"></div><div class="graphs"></div><div class="dials">${dials.join("")}</div>`;
}

function draw() {
  const find = (selector) => bench.querySelector(selector);
  const run = runs[chosen];
  const goes = runs.some(({ going }) => going);
  find("[data-act=learn]").textContent = goes ? "Stop" : "Learn";
  find("[data-act=second]").textContent = runs.length > 1 ? "One run" : "Two runs";
  for (const act of ["anew", "second", "save"]) find(`[data-act=${act}]`).disabled = !run;
  drawRuns(find(".runs"));
  find(".graphs").innerHTML = Object.keys(CURVES).map(graph).join("");
  for (const input of bench.querySelectorAll("[data-dial]")) {
    const dials = run?.dials ?? usual();
    input.value = stopOf(DIALS[input.dataset.dial], dials);
    const text = textOf(input.dataset.dial, dials);
    input.setAttribute("aria-valuetext", text);
    input.nextSibling.textContent = text;
  }
  const says = run && isSlow(run) ? slowly(run) : escaped(told);
  if (find(".word").written !== says) find(".word").innerHTML = find(".word").written = says;
}

const secondsLeft = ({ dials, steps, rate }) => (dials.steps - steps) / rate / 1000;
const isSlow = (run) => run.going && run.rate > 0 && secondsLeft(run) > PATIENCE;
/** On a slow device, how long it takes, and in the village an agent that has learned already. */
function slowly(run) {
  const is = (name) => textOf(name, run.dials) === textOf(name, usual());
  const same = Object.keys(DIALS).every((name) => ["seed", "steps"].includes(name) || is(name));
  const known = run.city.name === "village" && same;
  const other = known ? key("take", "take one that has learned") : "turn steps down";
  return `${Math.round(secondsLeft(run) / 60)} minutes left: ${other}.`;
}

/** A line for each run: how far it has come, and by which dials it differs from the other. */
function drawRuns(place) {
  const empty = (_, number) => {
    const head = '<span class="key"></span><b></b> / <span class="all"></span>';
    const choice = runs.length > 1 ? key("choose", head, number) : `<span>${head}</span>`;
    return `<div class="run ${RUNS[number]}">${choice} <small></small></div>`;
  };
  if (place.children.length !== runs.length) place.innerHTML = runs.map(empty).join("");
  runs.forEach(({ dials, steps, city }, number) => {
    const line = place.children[number]; // stays, with its focus
    const apart = number
      ? Object.keys(DIALS).filter((name) => textOf(name, dials) !== textOf(name, runs[0].dials))
      : [];
    line.classList.toggle("on", number === chosen);
    line.querySelector("b").textContent = grouped(steps);
    line.querySelector(".all").textContent = grouped(dials.steps);
    const here = city.name === stage.scene.state.city;
    const differs = apart.map((name) => `${name} ${textOf(name, dials)}`);
    const says = [...(here ? [] : [`over ${city.name}`]), ...differs];
    line.querySelector("small").textContent = says.join(", ");
  });
}

function graph(name) {
  const [of, low, least, text] = CURVES[name];
  const all = [...past, ...runs].flatMap(({ points }) => points);
  const high = Math.max(least, ...all.map((point) => of(point) ?? least));
  const last = [...runs.map(({ dials }) => dials.steps), ...past.map(({ steps }) => steps)];
  const steps = Math.max(1, ...last);
  const height = (value) => 100 - (100 * (Math.max(value, low) - low)) / (high - low);
  const line = ({ points }, kind) => {
    const known = points.filter((point) => of(point) !== null);
    const numbers = known.map((point) => [(200 * point.steps) / steps, height(of(point))]);
    const places = numbers.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`);
    return `<path class="curve ${kind}" d="${places.length ? `M${places.join("L")}` : ""}"/>`;
  };
  const value = ({ points }, number) => {
    const last = points.findLast((point) => of(point) !== null);
    return last ? `<b class="${RUNS[number]}">${text(of(last))}</b>` : "";
  };
  const grid = [low, 0, high].map((each) => `M0 ${height(each)}H200`).join("");
  return `<figure class="graph"><figcaption>${name} ${runs.map(value).join(" ")}</figcaption>
    <svg viewBox="0 0 200 100" preserveAspectRatio="none" aria-hidden="true"><path d="${grid}"/>
    ${past.map((run) => line(run, "past")).join("")}${runs.map((run, k) => line(run, RUNS[k])).join("")}</svg></figure>`;
}

const TURNS = { north: 0, east: 90, south: 180, west: 270 };
const SIGNS = {
  hover: "M-.1 0a.1 .1 0 1 0 .2 0a.1 .1 0 1 0 -.2 0",
  land: "M0 -.17L.17 0 0 .17 -.17 0z",
};

/** How good it would be to be over each cell, and what the agent would do there. */
function field({ values, best }, size) {
  const sign = (action, cell) => {
    if (action === null) return "";
    const there = `${at([Math.floor(cell / size), cell % size])} rotate(${TURNS[action] ?? 0})`;
    return `<path transform="${there}" d="${SIGNS[action] ?? "M-.17 .13L0 -.2 .17 .13z"}"/>`;
  };
  return [valued(values, size).cells, best.map(sign).join("")];
}

export const TRAIN = {
  title: "Train",
  bare: true, // its panel explains no signs, but words
  words: Object.keys(DIAL_WORDS),
  begins: true, // a flight is shown from its first step on
  still: ({ panel }) => !panel.values,
  html: () => '<div class="bench"></div>',
  under: () => `<g class="values">${drawn[0]}</g>`,
  over: ({ panel, film }) => {
    const path = film.flights[0].path.map(([row, col]) => `${col} ${row}`).join("L");
    return `<g class="field">${drawn[1]}</g>${panel.values ? `<path class="flown" d="M${path}"/>` : ""}<g class="rose"></g>`;
  },
  moment(there, { panel, film }, time, playing) {
    stage = there;
    if (!bench) frame();
    const place = stage.find(".bench");
    if (place.firstChild !== bench) place.replaceChildren(bench);
    asked = 0;
    if (wanted && panel.city.rows.length <= LARGEST) {
      const act = wanted;
      wanted = null;
      act();
    }
    draw();
    if (!playing) offer();
    if (!panel.values) drawn = ["", ""];
    else {
      const step = Math.min(Math.floor(time), panel.values.length - 1);
      if (panel.map?.step === step) drawn = field(panel.map, film.city.length);
      else stage.askWhenFree({ kind: "values", step });
      const over = stage.find(".map .rose");
      over.setAttribute("transform", `${at(film.flights[0].path[step])} scale(.6)`);
      over.innerHTML =
        time < film.flights[0].path.length - 1 ? rose(panel.values[step], null, false) : "";
    }
    [stage.find(".values").innerHTML, stage.find(".field").innerHTML] = drawn;
  },
};
