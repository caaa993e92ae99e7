// Saves a trained agent as checkpoint.py does: a safetensors file that Python and the labs load.

const TYPES = new Map([
  [Float32Array, "F32"],
  [Uint8Array, "U8"],
]);
const TORCH = { F32: "torch.float32", U8: "torch.uint8" };
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
      name: scenario.name.replace(ODD, "_").slice(0, LONGEST),
    },
    cities: [{ name: city.name, size }],
    size,
    training: { seed, steps, updates, double, frozen, turned, by: "the labs" },
  };
  return { tensors, about };
}

const bytesOf = ({ buffer, byteOffset, byteLength }) =>
  new Uint8Array(buffer, byteOffset, byteLength);

/** The names in the order of Python's `sorted`, with what the digest and the file say of each. */
const entriesOf = (tensors) =>
  Object.keys(tensors)
    .sort()
    .map((name) => {
      const { shape, values } = tensors[name];
      return { name, shape, type: TYPES.get(values.constructor), bytes: bytesOf(values) };
    });

function joined(parts) {
  const all = new Uint8Array(parts.reduce((count, part) => count + part.length, 0));
  parts.reduce((begin, part) => (all.set(part, begin), begin + part.length), 0);
  return all;
}

/** SHA-256 of the JSON and of every tensor, as `_digest` in Python makes it. */
async function digestOf(tensors, about) {
  const text = new TextEncoder();
  const parts = entriesOf(tensors).flatMap(({ name, shape, type, bytes }) => {
    const lengths = shape.length === 1 ? `${shape[0]},` : shape.join(", ");
    return [text.encode(`${name} ${TORCH[type]} (${lengths})`), bytes];
  });
  const digest = await crypto.subtle.digest("SHA-256", joined([text.encode(about), ...parts]));
  return [...new Uint8Array(digest)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

function fileOf(tensors, metadata) {
  const header = { __metadata__: metadata };
  let end = 0;
  const entries = entriesOf(tensors);
  for (const { name, shape, type, bytes } of entries)
    header[name] = { dtype: type, shape, data_offsets: [end, (end += bytes.length)] };
  const json = JSON.stringify(header);
  const told = new TextEncoder().encode(json);
  const padded = new Uint8Array(Math.ceil(told.length / 8) * 8).fill(32);
  padded.set(told);
  const length = new Uint8Array(8);
  new DataView(length.buffer).setBigUint64(0, BigInt(padded.length), true);
  return joined([length, padded, ...entries.map(({ bytes }) => bytes)]);
}

/** The bytes of a checkpoint. @returns {Promise<Uint8Array>} */
export async function checkpoint(trainer) {
  const { tensors, about } = partsOf(trainer);
  const told = JSON.stringify(about);
  return fileOf(tensors, { uavdh_lite: told, sha256: await digestOf(tensors, told) });
}
