// Saves and reads an agent as checkpoint.py does: a safetensors file for Python and the labs.

import { Agent } from "./pilots.js";
import { InputError, hasChannel, require } from "./world.js";

const TYPES = { Float32Array: "F32", Uint8Array: "U8" };
const TORCH = { F32: "torch.float32", F16: "torch.float16", U8: "torch.uint8" };
const READ = {
  U8: (content) => content,
  F32: (content) => new Float32Array(content.buffer),
  F16: (content) => new Float16Array(content.buffer),
};
const KINDS = ["Recipe", "BeyondRecipe", "ImitationRecipe"]; // what pilots.js flies
export const DAMAGED = "this file is damaged, its checksum is wrong; copy or train it again";
const [LONGEST, ODD] = [50, /[/\\:*?"<>|]/g]; // of a scenario's name in Python: its length, what it has not

/** An agent as it is now: tensors by name, and JSON values. */
export function partsOf({
  environment: { city, size },
  scenario,
  dials,
  online,
  steps,
  updates,
  turned,
}) {
  const { double, frozen, seed, ...told } = dials;
  const recipe = { ...told, name: "labs" };
  recipe.replay_prefill = Math.min(recipe.replay_prefill, recipe.replay_capacity);
  const tensors = { cities: { shape: [1, size, size], values: city.kinds } };
  for (const { name, shape, values } of online.weights)
    tensors[`network.${name}`] = { shape, values: Float32Array.from(values) };
  const about = {
    format: 1,
    kind: "agent",
    recipe,
    scenario: {
      city: city.name,
      ...scenario,
      name: [...scenario.name.replace(ODD, "_")].slice(0, LONGEST).join(""),
    },
    cities: [{ name: city.name, size }],
    size,
    training: { seed, steps, updates, double, frozen, turned, by: "the labs" },
  };
  return { tensors, about };
}

/** What the digest and the file say of each tensor. */
const entriesOf = (tensors) =>
  Object.entries(tensors).map(([name, { shape, values }]) => {
    const { buffer, byteOffset, byteLength } = values;
    const bytes = new Uint8Array(buffer, byteOffset, byteLength);
    return { name, shape, dtype: TYPES[values.constructor.name], bytes };
  });

function joined(parts) {
  const all = new Uint8Array(parts.reduce((count, part) => count + part.length, 0));
  parts.reduce((begin, part) => (all.set(part, begin), begin + part.length), 0);
  return all;
}

const PRIMES = [];
for (let n = 2; PRIMES.length < 64; n++) if (PRIMES.every((prime) => n % prime)) PRIMES.push(n);
const fractions = (root) => Uint32Array.from(PRIMES, (prime) => (root(prime) % 1) * 2 ** 32);
const turned = (word, by) => (word >>> by) | (word << (32 - by));

/** SHA-256 in hexadecimal; the one of browsers is missing where a page comes without https. */
export function sha256(bytes) {
  const [hash, constants] = [fractions(Math.sqrt).slice(0, 8), fractions(Math.cbrt)];
  const padded = new Uint8Array(64 * Math.ceil((bytes.length + 9) / 64));
  padded.set(bytes);
  padded[bytes.length] = 128;
  const view = new DataView(padded.buffer);
  view.setBigUint64(padded.length - 8, BigInt(8 * bytes.length));
  const words = new Int32Array(64);
  for (let begin = 0; begin < padded.length; begin += 64) {
    let [a, b, c, d, e, f, g, h] = hash;
    for (let k = 0; k < 64; k++) {
      const [x, y] = k < 16 ? [0, 0] : [words[k - 15], words[k - 2]];
      const near = turned(x, 7) ^ turned(x, 18) ^ (x >>> 3);
      const far = turned(y, 17) ^ turned(y, 19) ^ (y >>> 10);
      words[k] = k < 16 ? view.getInt32(begin + 4 * k) : words[k - 16] + near + words[k - 7] + far;
      const sum = turned(e, 6) ^ turned(e, 11) ^ turned(e, 25);
      const one = (h + sum + ((e & f) ^ (~e & g)) + constants[k] + words[k]) | 0;
      const two = (turned(a, 2) ^ turned(a, 13) ^ turned(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
      [h, g, f, e, d, c, b, a] = [g, f, e, (d + one) | 0, c, b, a, (one + two) | 0];
    }
    [a, b, c, d, e, f, g, h].forEach((each, k) => (hash[k] += each));
  }
  return Array.from(hash, (word) => word.toString(16).padStart(8, "0")).join("");
}

/** The checksum of a file: of its JSON and every tensor, as `_digest` in Python makes it. */
function digestOf(entries, about) {
  const text = new TextEncoder();
  const sorted = entries.toSorted((one, other) => (one.name < other.name ? -1 : 1));
  const parts = sorted.flatMap(({ name, shape, dtype, bytes }) => {
    const lengths = shape.length === 1 ? `${shape[0]},` : shape.join(", ");
    return [text.encode(`${name} ${TORCH[dtype]} (${lengths})`), bytes];
  });
  return sha256(joined([text.encode(about), ...parts]));
}

/** The checksum that the file of an agent will have. @param {object} parts see `partsOf` */
export const digestOfParts = ({ tensors, about }) =>
  digestOf(entriesOf(tensors), JSON.stringify(about));

/** The bytes of a checkpoint. @returns {Uint8Array} */
export function checkpoint(trainer) {
  const parts = partsOf(trainer);
  const metadata = { uavdh_lite: JSON.stringify(parts.about), sha256: digestOfParts(parts) };
  const [header, entries] = [{ __metadata__: metadata }, entriesOf(parts.tensors)];
  let end = 0;
  for (const { name, shape, dtype, bytes } of entries)
    header[name] = { dtype, shape, data_offsets: [end, (end += bytes.length)] };
  const told = new TextEncoder().encode(JSON.stringify(header));
  const padded = new Uint8Array(Math.ceil(told.length / 8) * 8).fill(32);
  padded.set(told);
  const length = new Uint8Array(8);
  new DataView(length.buffer).setBigUint64(0, BigInt(padded.length), true);
  return joined([length, padded, ...entries.map(({ bytes }) => bytes)]);
}

/** An agent from a checkpoint, the bytes of a safetensors file; `InputError` if it is none. */
export function readAgent(bytes) {
  let [agent, about, whole] = [];
  try {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const begin = 8 + Number(view.getBigUint64(0, true));
    const header = JSON.parse(new TextDecoder().decode(bytes.subarray(8, begin)));
    const { __metadata__: metadata, ...described } = header;
    const entries = Object.entries(described).map(([name, { dtype, shape, data_offsets }]) => {
      const [from, to] = data_offsets.map((each) => begin + each);
      return { name, dtype, shape, bytes: bytes.slice(from, to) };
    });
    const { uavdh_lite: told, sha256: digest } = metadata;
    about = JSON.parse(told);
    whole = digest === undefined || digest === digestOf(entries, told); // the page's own have none
    const values = ({ shape, dtype, bytes: content }) => ({ shape, values: READ[dtype](content) });
    const tensors = Object.fromEntries(entries.map((each) => [each.name, values(each)]));
    if (whole && KINDS.includes(about.recipe.kind)) agent = new Agent(about, tensors, digest);
  } catch {
    throw new InputError("not an agent of this package, or a damaged file: open a checkpoint");
  }
  require(whole, DAMAGED);
  require(agent, `this page cannot fly agents of the recipe kind ${about.recipe.kind}`);
  const { channel } = about.scenario;
  require(hasChannel(channel), "this agent was trained over another radio channel than the page's");
  return agent;
}
