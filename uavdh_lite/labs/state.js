// What the stage shows: one mission, who flies it, and how one looks at it. A stage never changes:
// `CHANGES` makes the next one from what somebody does. As JSON it is the saved file, and packed
// into letters the page's address.

import { listed } from "./words.js";
import {
  ACTIONS,
  City,
  InputError,
  MAX_SIZE,
  Mission,
  missionFromJson,
  require,
  sum,
} from "./world.js";

const [FORMAT, VERSION] = ["uavdh_lite stage", 1];
const EXIF = 0x65584966; // the type of a PNG's part: eXIf
const PAINTS =
  "Black or white: open ground; blue: landing; yellow: tall building; green: low; red: no-fly zone";
export const TOOLS = ["fly", "compare", "think", "channel", "paint", "train"];
export const LETTERS = "neswhl"; // of the actions, in their order
export const YOU = "you";
const DIGEST = / ([0-9a-f]{16})$/;
/** The name of an agent that the page has not from the start ends in the digest of its file. */
export const namedBy = (title, digest) => `${title} ${digest.slice(0, 16)}`;
const digestIn = (name) => name.match?.(DIGEST)?.[1] ?? name;
const titleIn = (name) => `${name}`.replace(DIGEST, "");
const USUAL_LOOKS = { value: false, centred: false }; // ways to look at the map in Think

/**
 * @typedef {object} Stage
 * @property {import("./world.js").Mission} mission
 * @property {[string, string]} policies names of the two that fly it; `you` is the flight by hand
 * @property {string} tool one of `TOOLS`
 * @property {string} flown the actions that were flown by hand, in `LETTERS`
 * @property {number} step the step that is shown; −1 for the last
 * @property {number} device the device whose radio link is shown
 * @property {object} looks whether each way to look is chosen
 *
 * @typedef {object} Shelf what there is to choose from
 * @property {Object<string, import("./world.js").City>} cities by name
 * @property {Object<string, object>} scenarios ranges of the missions, by the city's name
 * @property {(city: object) => string[]} known the names of who can fly over a city, agents first
 * @property {Object<string, object>} agents by name
 * @property {string[]} tools those that this page can show
 */

/** The stage of a mission, with the agent and greedy. */
export const newStage = (mission, shelf) => ({
  mission,
  policies: usualPolicies(mission.city, shelf),
  tool: "fly",
  flown: "",
  step: -1,
  device: 0,
  looks: { ...USUAL_LOOKS },
});

/** The agent and its rival: the DDQN agent where one was trained for the city. */
function usualPolicies(city, { known }) {
  const names = known(city);
  const agent = names.find((name) => name.endsWith("_ddqn")) ?? names[0];
  return [agent === "greedy" ? "random" : agent, "greedy"];
}

/** Two that fly over a city: those of `policies` that can, and others in place of the rest. */
export function flying(policies, city, shelf, names = [...shelf.known(city), YOU]) {
  const usual = usualPolicies(city, shelf);
  const there = usual.map((name, k) => (names.includes(policies[k]) ? policies[k] : name));
  return there[0] === there[1] ? usual : there;
}

/** The same look at another mission; what was flown by hand was flown in the old one. */
export function withMission(stage, mission, shelf) {
  let { policies } = stage;
  const { city } = mission;
  if (city !== stage.mission.city) {
    const before = usualPolicies(stage.mission.city, shelf);
    policies = policies.map((name, k) => name !== before[k] && name);
    policies = flying(policies, city, shelf, shelf.known(city));
  }
  const device = Math.min(stage.device, mission.devices.length - 1);
  return { ...stage, mission, policies, flown: "", step: -1, device };
}

/** What missions over a city are drawn from: its agent's; without one, time to cross it twice. */
export function scenarioOf(city, { cities, scenarios, agents, channel }) {
  const known = Object.values(cities).find((each) => scenarios[each.name] && each.sameAs(city));
  if (known) return scenarios[known.name];
  const taught = Object.values(agents).find(({ of }) => of?.sameAs(city));
  if (taught) return taught.agent.scenario;
  const most = Math.min(3, sum(city.openToDevices));
  return {
    name: city.name,
    devices: [1, most],
    data: [5, 20],
    flying_time: [2 * city.size, 4 * city.size],
    channel,
  };
}

export const randomMission = (city, number, shelf) =>
  Mission.draw(scenarioOf(city, shelf), city, number);

/** The stage with a random mission over a city. */
export const overCity = (stage, city, shelf) =>
  withMission(stage, randomMission(city, 0, shelf), shelf);

/** What the saved file holds. */
export const stageAsJson = ({ mission, ...look }) => ({
  format: FORMAT,
  version: VERSION,
  ...look,
  mission: mission.asJson(),
});

/**
 * The stage of a saved file, or of a mission's file.
 * @param {string[]} notes takes what is said of rivals that do not fly
 */
export function readFile(text, shelf, notes = []) {
  let values = null;
  try {
    values = JSON.parse(text.replace(/^\ufeff/, ""));
  } catch {
    require(!/^\s*{/.test(text), "this file is damaged or cut off: save it again");
    throw new InputError(
      "not a file of the labs: open a saved page (.json), a city (.png) or an agent (.safetensors)",
    );
  }
  if (values?.format === "uavdh_lite mission") return newStage(missionFromJson(values), shelf);
  const known = values?.format === FORMAT;
  require(known, "this is neither a saved page nor a mission: open one that More → Save made");
  require(values.version === VERSION, `this file is not of version ${VERSION} of the labs`);
  const mission = missionFromJson(values.mission);
  const names = [...shelf.known(mission.city), YOU];
  const fits = (value, least, most) => value >= least && value <= most;
  const { tool, flown, step, device, looks } = values;
  const told = values.policies ?? usualPolicies(mission.city, shelf);
  const here = (name) => names.find((each) => digestIn(each) === digestIn(name)) ?? name;
  const policies = told.map(here);
  const strangers = policies.filter((name) => !names.includes(name)).map(titleIn);
  if (strangers.length)
    notes.push(`${listed(strangers.map((name) => `“${name}”`))} cannot fly here, so others do.`);
  return {
    mission,
    policies: flying(policies, mission.city, shelf),
    tool: shelf.tools.includes(tool) ? tool : shelf.tools[0],
    flown: /^[neswhl]*$/.test(flown) ? flown : "",
    step: fits(step, 0, mission.flyingTime) ? step : -1,
    device: fits(device, 0, mission.devices.length - 1) ? device : 0,
    looks: { ...USUAL_LOOKS, ...looks },
  };
}

/** Bytes through a stream that packs or unpacks them; one rejection where they do not fit it. */
async function through(bytes, { writable, readable }) {
  const writer = writable.getWriter();
  const written = writer.write(bytes).then(() => writer.close());
  const [packed] = await Promise.all([new Response(readable).arrayBuffer(), written]);
  return new Uint8Array(packed);
}
const ADDRESS = { alphabet: "base64url", omitPadding: true };

/** What a file holds in letters that may stand in an address. */
export async function linkOf(values) {
  const bytes = new TextEncoder().encode(JSON.stringify(values));
  return (await through(bytes, new CompressionStream("deflate"))).toBase64(ADDRESS);
}

/** The text of a link; the error says why it cannot be opened. */
export async function textOfLink(link) {
  try {
    const bytes = Uint8Array.fromBase64(link, ADDRESS);
    return new TextDecoder().decode(await through(bytes, new DecompressionStream("deflate")));
  } catch {
    throw new InputError("this link is damaged: copy the whole link again");
  }
}

/** The parts of a PNG without the one by which browsers, and not Python, would turn it. */
function unturned(bytes) {
  const [parts, view] = [[bytes.subarray(0, 8)], new DataView(bytes.buffer, bytes.byteOffset)];
  for (let at = 8, next; at + 8 <= bytes.length; at = next) {
    next = at + 12 + view.getUint32(at);
    if (view.getUint32(at + 4) !== EXIF) parts.push(bytes.subarray(at, next));
  }
  return parts;
}

/** The city of a picture, a PNG with one pixel a cell, under a name. */
export async function cityOfPicture(file, name) {
  const exact = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
  const picture = await createImageBitmap(new Blob(unturned(file.bytes)), exact).catch(() => null);
  require(picture, "this is not a readable PNG: open one that Save as PNG made in Paint");
  const { width, height } = picture;
  const fits = Math.max(width, height) <= MAX_SIZE;
  require(fits, `${width} × ${height} pixels, at most ${MAX_SIZE} on a side fit`);
  const canvas = new OffscreenCanvas(width, height).getContext("2d");
  canvas.drawImage(picture, 0, 0);
  try {
    const { data } = canvas.getImageData(0, 0, width, height);
    for (let at = 0; at < data.length; at += 4)
      if (data.subarray(at, at + 4).every((part) => part > 223)) data.fill(0, at, at + 3);
    return City.fromPixels(name, width, height, data);
  } catch ({ message }) {
    throw new InputError(`${message.replace(name, file.name)}. ${PAINTS}`);
  }
}

/** A city as a PNG, one pixel a cell. @returns {Promise<Blob>} */
export function pictureOf({ size, pixels }) {
  const canvas = new OffscreenCanvas(size, size);
  canvas.getContext("2d").putImageData(new ImageData(pixels, size, size), 0, 0);
  return canvas.convertToBlob();
}

const put = (values, index, value) => values.map((each, k) => (k === index ? value : each));
const without = (values, index) => values.filter((_, k) => k !== index);
const change = (stage, shelf, changes) => withMission(stage, stage.mission.with(changes), shelf);

/** What each event makes of a stage: `CHANGES[kind](stage, told, shelf)`; errors say why not. */
export const CHANGES = {
  /** Moves a device, or with −1 the start, to a cell or by some rows and columns. */
  move(stage, { device, cell, by }, shelf) {
    const { devices, start } = stage.mission;
    const here = devices[device] ?? start;
    cell ??= here.map((axis, k) => axis + by[k]);
    if (String(cell) === String(here)) return stage;
    if (device < 0) return change(stage, shelf, { start: cell });
    return change(stage, shelf, { devices: put(devices, device, cell) });
  },
  data: (stage, { device, value }, shelf) =>
    change(stage, shelf, { data: put(stage.mission.data, device, value) }),
  time: (stage, { value }, shelf) => change(stage, shelf, { flyingTime: value }),
  /** Adds a device, near the middle. */
  add(stage, told, shelf) {
    const { city, devices, data } = stage.mission;
    const taken = devices.map((cell) => city.cell(cell));
    const far = (cell) => sum(city.position(cell).map((at) => Math.abs(at - city.size / 2)));
    const free = [...city.kinds.keys()]
      .filter((cell) => city.openToDevices[cell] && !taken.includes(cell))
      .sort((one, other) => far(one) - far(other));
    require(free.length, "no cell is left for another device: leave some free");
    const there = city.position(free[0]);
    return change(stage, shelf, { devices: [...devices, there], data: [...data, 10] });
  },
  remove(stage, { device }, shelf) {
    const { devices, data, maxDevices } = stage.mission;
    require(devices.length > 1, `the last device stays: a mission here has 1 to ${maxDevices}`);
    return change(stage, shelf, { devices: without(devices, device), data: without(data, device) });
  },
  new: (stage, told, shelf) =>
    withMission(stage, randomMission(stage.mission.city, stage.mission.seed + 1, shelf), shelf),
  policy(stage, { which, name }) {
    const policies = put(stage.policies, which, name);
    if (policies[0] === policies[1]) policies[1 - which] = stage.policies[which];
    return { ...stage, policies, step: -1 };
  },
  fly: (stage, { action }) => ({ ...stage, flown: stage.flown + LETTERS[ACTIONS.indexOf(action)] }),
  again: (stage) => ({ ...stage, flown: "" }),
  tool: (stage, { tool }) => ({ ...stage, tool }),
  show: (stage, { step }) => ({ ...stage, step }),
  look: (stage, { device }) => ({ ...stage, device }),
  /** Chooses a way to look. */
  see: (stage, { name, value }) => ({ ...stage, looks: { ...stage.looks, [name]: value } }),
  /** Paints cells with one of the city's signs; where something stands, the city stays as it is. */
  paint(stage, { cells, sign, name }, shelf) {
    const { city, devices, start } = stage.mission;
    const rows = city.rows.map((row) => [...row]);
    const stands = [...devices, start].map(String);
    const free = cells.filter((cell) => !stands.includes(String(cell)));
    if (free.every(([row, col]) => rows[row][col] === sign)) return stage;
    for (const [row, col] of free) rows[row][col] = sign;
    const painted = City.fromText(name, rows.map((row) => row.join("")).join("\n"));
    return change(stage, shelf, { city: painted });
  },
};
