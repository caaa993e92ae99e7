// What the learning JavaScript answers to what test_learning.py asks.

import { checkpoint } from "../../uavdh_lite/labs/checkpoint.js";
import { Trainer } from "../../uavdh_lite/labs/training.js";
import { stateOf } from "./twin.js";

const numbers = (tensors, part = "values") =>
  Object.fromEntries(Object.entries(tensors).map(([name, tensor]) => [name, [...tensor[part]]]));
/** Gradients, weights after some updates with the same batch, and what they began with. */
function updated({ run, weights, batch, updates }) {
  const trainer = new Trainer(run);
  const given = Object.fromEntries(
    Object.entries(weights).map(([name, values]) => [name, { values }]),
  );
  for (const network of [trainer.online, trainer.target]) network.tensors = given;
  const told = batch.map(({ state, next, ...each }) => ({
    ...each,
    state: stateOf(state),
    next: stateOf(next),
  }));
  const values = [
    ...trainer.valuesOf(
      [trainer.online],
      told.map(({ state }) => state),
    )[0],
  ].slice(0, 6 * told.length);
  const targets = trainer.targets(told);
  const gradients = [];
  for (let k = 0; k < updates; k++) {
    trainer.update(told);
    gradients.push(numbers(trainer.online.tensors, "gradient"));
  }
  const [online, target] = [trainer.online, trainer.target].map((network) =>
    numbers(network.tensors),
  );
  return { values, targets, gradients, losses: trainer.losses, online, target };
}

/** A run of so many steps; `turns` are dials by the step before which they are turned. */
async function learned({ run, steps, turns = {} }) {
  const trainer = new Trainer(run);
  const first = numbers(trainer.target.tensors);
  const told = [];
  for (let k = 0; k < steps; k++) {
    if (turns[k]) trainer.turn(turns[k]);
    trainer.step();
    const { replay, crashReward, temperature, learningRate, states, updates } = trainer;
    told.push({
      crashReward,
      temperature,
      learningRate,
      updates,
      count: replay.count(trainer.dials),
    });
    if (k === steps - 1) {
      const ends = (kind) => replay.reward.filter((_, at) => replay.end[at] === kind);
      const { dials, generator } = trainer;
      const drawn = replay.sample(dials.batch_size, dials, generator, states);
      const recent = new Set(
        Array.from(
          { length: 4 },
          (_, age) => (replay.head - 1 - age + replay.steps) % replay.steps,
        ).flatMap((step) =>
          replay.states.slice(step * replay.environments, (step + 1) * replay.environments),
        ),
      );
      return {
        first,
        online: numbers(trainer.online.tensors),
        target: numbers(trainer.target.tensors),
        landings: [...ends(1)],
        crashes: [...ends(2)],
        most: Math.max(...drawn.map(({ state }) => state.dataInitial.filter(Boolean).length)),
        discounts: drawn.map(({ discount }) => discount),
        recent: drawn.every(({ state }) => recent.has(state)),
        different: new Set(drawn.map(({ state }) => state)).size,
        told,
        points: trainer.points,
        file: Buffer.from(checkpoint(trainer)).toString("base64"),
      };
    }
  }
}

export const answer = async ({ updates = [], runs = [] }) => ({
  updates: updates.map(updated),
  runs: await Promise.all(runs.map(learned)),
});
