// Two flights of one mission: where they part, who is ahead and why, as facts.

import { ACTIONS, CHANNEL, LAND, REWARDS, pathLossDb, rate, sum } from "./world.js";

const AHEAD = 2; // of the return: a win
const LEVEL = 0.5;
const LITTLE = 0.1; // data units: nothing to speak of
export const NONE = 0.05; // data units: all is collected
const ENOUGH = 0.5; // worth a word
const MUCH = 2; // a reason
/** What `verdict` and `isDuel` call a win and level, as a fact; `sooner` counts the steps that make a win of the same data. */
export const RULE = {
  kind: "rule",
  ahead: AHEAD,
  sooner: Math.floor(AHEAD / -REWARDS.movement) + 1,
  level: LEVEL,
};
const NEAR = 2; // cells between them
const LONG = 3; // more steps without data than the other's that are worth a word

const cellsApart = (one, other, size) =>
  Math.abs(Math.floor(one / size) - Math.floor(other / size)) +
  Math.abs((one % size) - (other % size));
const dataApart = (one, other) => Math.max(...one.map((each, k) => Math.abs(each - other[k])));

/**
 * The step in which two flights part for good; null if they come to the same end.
 *
 * That is where they were nearest when they were near each other for the last time, with about the
 * same data: two ways to one device are no parting. Where they had acted differently just before, it is
 * the first of these steps. If they end near each other, it is the last cell that they have in common in
 * which they act differently.
 * @param {import("./flights.js").Flight} first
 * @param {number} size of the city
 */
export function parting(first, second, size) {
  const steps = Math.min(first.action.length, second.action.length);
  if (steps === 0) return null;
  const each = (what) => Array.from({ length: steps + 1 }, (_, k) => what(k));
  const far = each((k) => cellsApart(first.uavCell[k], second.uavCell[k], size));
  const apart = each((k) => dataApart(first.dataLeft[k], second.dataLeft[k]));
  if (far[steps] === 0 && apart[steps] < ENOUGH && first.action.length === second.action.length)
    return null;
  const differ = each((k) => k < steps && first.action[k] !== second.action[k]);
  const near = each((k) => far[k] <= NEAR && apart[k] < MUCH);
  const last = near.lastIndexOf(true);
  const begin = near.lastIndexOf(false, last) + 1; // of those up to the last
  const meeting = [...differ.keys()].filter((k) => differ[k] && k >= begin && k <= last);
  if (near[steps] || !meeting.length) {
    const same = each((k) => far[k] === 0 && apart[k] < Math.max(ENOUGH, apart[steps]));
    const acts = each((k) => same[k] && differ[k]).lastIndexOf(true);
    return acts >= 0 ? acts : same.lastIndexOf(true, steps - 1);
  }
  let parts = meeting.reduce((one, other) => (far[other] <= far[one] ? other : one));
  while (far[parts] > 0 && meeting.includes(parts - 1)) parts -= 1;
  return parts;
}

/**
 * Who is ahead, and by what.
 * @param {[import("./words.js").Who, import("./words.js").Who]} who
 * @param {[object, object]} results from `numbers`
 */
export function verdict(who, results) {
  if (results.some(({ steps }) => steps === 0)) return { kind: "empty" };
  if (!results.every(({ ended }) => ended)) return { kind: "air" };
  if (!results.some(({ landed }) => landed)) return { kind: "crashes" };
  const difference = lead(results);
  if (Math.abs(difference) < LEVEL) return { kind: "level", ...gains(who, results) };
  const ahead = difference > 0 ? 0 : 1;
  const [won, lost] = [results[ahead], results[1 - ahead]];
  const both = { who: who[ahead], other: who[1 - ahead] };
  if (won.landed && !lost.landed) return { kind: "crash", ...both };
  const more = surplus("collected", [won, lost]);
  const sooner = lost.steps - won.steps;
  const refusals = more < 0 && -REWARDS.movement * sooner <= -more; // time does not explain it
  return {
    kind: wins(won, lost) ? "wins" : "ahead",
    ...both,
    more,
    sooner,
    by: Math.abs(difference),
    refusals,
  };
}

/** How much more the first of two results has of what a `name` names, as both are shown. */
function surplus(name, results) {
  const [first, second] = results.map((each) => Number(each[name].toFixed(1)));
  return Number((first - second).toFixed(1));
}

/** By how much the first's return is ahead. */
export const lead = (results) => surplus("return", results);
const wins = (...both) => lead(both) > AHEAD && surplus("collected", both) >= 0;

/** Who of two that landed brings more data, or as much sooner, and by how much. */
function gains(who, results) {
  if (!results.every(({ landed }) => landed)) return {};
  const more = surplus("collected", results);
  const sooner = results[1].steps - results[0].steps;
  const first = (more || sooner) >= 0;
  return {
    who: who[first ? 0 : 1],
    data: results[0].collected,
    more: Math.abs(more),
    sooner: first ? sooner : -sooner,
  };
}

/**
 * What each does where they part, and what comes of it: facts, each with the step to look at, `look`.
 * @param {number | null} part from `parting`
 * @param {import("./world.js").Environment} environment
 */
export function reasons(who, flights, part, environment) {
  if (flights.some(({ action }) => !action.length)) return [];
  const first = flights[0].action.findIndex((action, k) => action !== flights[1].action[k]);
  if (part === null) return [{ kind: "same", step: first }];
  const by = Math.max(...flights.map((flight) => muchSince(flight, part))); // both are looked at for as long
  const ends = flights.map((flight, k) => ({ who: who[k], ...towards(flight, part, by) }));
  const both = ends.some(
    ({ device }, k) =>
      // the other, which gets little, leaves as little there
      device !== undefined &&
      ends[1 - k].device === undefined &&
      leftAt(flights[1 - k], by)[device] - leftAt(flights[k], by)[device] < ENOUGH,
  );
  const apart = !both && (ends[0].device !== ends[1].device || ends[0].home !== ends[1].home);
  const acts = flights.map((flight, k) => ({ who: who[k], ...acted(flight, part) }));
  const differ = apart || flights[0].action[part] !== flights[1].action[part];
  const facts = differ
    ? [{ kind: "part", step: part, acts, ends: apart ? ends : null, look: part }]
    : [];
  if (first >= 0 && first < part) {
    const far = Array.from({ length: part - first }, (_, k) =>
      cellsApart(...flights.map(({ uavCell }) => uavCell[first + 1 + k]), environment.size),
    );
    facts.push({
      kind: "first",
      step: first,
      part,
      near: Math.max(...far) <= NEAR,
      ahead: aheadAt(who, flights, part),
      look: first,
    });
  }
  if (flights.some(({ landed, timeLeft }) => !landed && timeLeft.at(-1) > 0)) return facts; // one is in the air
  const behind = sum(flights[0].reward) < sum(flights[1].reward) ? 0 : 1;
  const about = { who: who[behind], other: who[1 - behind] };
  const [late, ahead] = [flights[behind], flights[1 - behind]];
  const last = lasts(who, flights, environment.timeToLand);
  const slower = last && last[behind].step > last[1 - behind].step;
  const causes = [
    shadowed(late, ahead, slower, environment),
    waits(late, ahead, environment),
  ].filter(Boolean);
  facts.push(...causes.map((each) => ({ ...each, ...about })));
  const [spent, others] = [late, ahead].map(spentBy);
  const stray = astray(late);
  const worse = spent.idle > others.idle; // else the count speaks for who is behind
  if (
    worse &&
    (spent.idle - others.idle >= LONG ||
      spent.idle + spent.brings - others.idle - others.brings >= LONG)
  ) {
    if (!last || stray.stretches.length)
      facts.push({
        kind: "spends",
        ...about,
        spent,
        others,
        ...stray,
        since: nothingSince(late),
        sealed: sealedLeft(late, stray, environment),
      });
  } else {
    const idlers = flights
      .map((flight, k) => ({ who: who[k], ...astray(flight) }))
      .filter(({ hovers, turns }) => hovers + turns >= 2 * LONG)
      .map((each) => ({
        ...each,
        sealed: sealedLeft(flights[who.indexOf(each.who)], each, environment),
      }));
    if (idlers.length) facts.push({ kind: "idles", idlers });
  }
  const more = flights[0].dataLeft.at(-1).map((each, k) => each - flights[1].dataLeft.at(-1)[k]);
  const fewer = sum(more) > 0 ? 0 : 1; // who brings less data
  const devices = Array.from(more, (each, device) => ({ device, more: fewer === 0 ? each : -each }))
    .filter((each) => Math.abs(each.more) >= LITTLE)
    .sort((one, other) => other.more - one.more);
  if (devices[0]?.more >= ENOUGH) {
    const [{ device }] = devices;
    const order = [fewer, 1 - fewer];
    const [spare, spared] = order.map((k) => flights[k].timeLeft.at(-1));
    const turns = order.map((k) => turnsHome(flights[k], environment.timeToLand));
    const later = flights[fewer].landed && turns[0] < turns[1] && spare > spared; // the other has used the time
    const unused = later || spare >= spared + LONG ? spare : 0; // else it explains nothing
    const [loser, winner] = order.map((k) => ({ who: who[k], ...got(flights[k], device) }));
    facts.push({
      kind: "leaves",
      devices,
      unused,
      used: flights[fewer].landed && spare === 0,
      turns: later ? turns : null,
      loser,
      winner,
      look: winner.first < 0 ? undefined : winner.first,
    });
  }
  if (last) facts.push({ kind: "lasts", ends: last });
  const alike =
    facts.every(({ kind }) => kind === "part") &&
    !apart &&
    devices.every(({ more }) => Math.abs(more) < ENOUGH);
  return alike ? [...facts, { kind: "ways", step: part }] : facts;
}

/**
 * The steps in which one flight stays in a device's radio shadow, while the other sees the device and gets MUCH more from it than
 * the first gets from all, if buildings are the cause: in sight, it could have got as much more, and it leaves more there or
 * comes back for it and is `slower`. `rates` are what it hears there and would in sight, in units a slot, as the tool Channel says it;
 * there is no such fact over a real place, where the shadow is the model's alone.
 */
function shadowed(late, ahead, slower, environment) {
  if (environment.meanSnrDb) return null;
  const {
    pathLossExponent: [hidden, seen],
    slots,
  } = CHANNEL;
  const found = Array.from(late.states[0].deviceCells).flatMap((cell, device) => {
    const [sight, transmit] = [environment.sight(cell), environment.transmitSnrDb];
    const all = (flight, k, sees) =>
      [k, k + 1].every((at) => Boolean(sight[flight.uavCell[at]]) === sees);
    const together = stretchesOf(
      Math.min(late.action.length, ahead.action.length),
      (k) => all(late, k, false) && all(ahead, k, true) && ahead.dataLeft[k][device] >= NONE,
    );
    const snr = together.length ? environment.snrMap(cell) : null;
    return together.map(([first, last]) => {
      const there = late.uavCell.slice(first + 1, last + 2).map((at) => snr[at]);
      const mean = (loss) =>
        sum(there.map((each) => rate(transmit - (transmit - each) * loss))) / there.length;
      const rates = [mean(1), mean(seen / hidden)];
      const [some, others] = [late, ahead].map((flight) => givenBy(flight, first, last + 1));
      const could = Math.min(
        others[device],
        leftAt(late, first)[device],
        rates[1] * slots * there.length,
      );
      const leaves = late.dataLeft.at(-1)[device] - ahead.dataLeft.at(-1)[device] >= ENOUGH;
      const counts =
        leaves || (slower && givenBy(late, last + 1, late.action.length)[device] >= MUCH);
      return {
        kind: "shadow",
        device,
        first,
        last,
        rates,
        amounts: [some[device], others[device]],
        more: counts ? could - sum(some) : 0,
        look: first,
      };
    });
  });
  const most = found.reduce((one, other) => (one?.more >= other.more ? one : other), null);
  return most?.more >= MUCH ? most : null;
}

/**
 * The longest stretch in which one flight hovers and hears little, the devices that are the cause because they give most of it and are
 * `sealed` in, and what the other, which flies nearer to the devices, gets in a step on average. Over a real place, walls are not the cause.
 */
function waits(late, ahead, environment) {
  const { size } = environment;
  const brings = ({ dataLeft }) => dataLeft.slice(1).map((left, k) => sum(dataLeft[k]) - sum(left));
  const [gets, others] = [late, ahead].map(brings);
  const stays = stretchesOf(
    gets.length,
    (k) => late.uavCell[k + 1] === late.uavCell[k] && gets[k] >= LITTLE,
  );
  const [first, last] = stays.reduce(
    (one, other) => (other[1] - other[0] > one[1] - one[0] ? other : one),
    [0, -1],
  );
  if (last - first + 1 < 2 * LONG) return null;
  const hears = gets.slice(first, last + 1);
  const some = others.filter((each) => each >= LITTLE);
  const mean = sum(some) / some.length;
  const far = (flight, from, to, cell) =>
    Math.min(...Array.from(flight.uavCell.slice(from, to), (at) => cellsApart(at, cell, size)));
  const given = givenBy(late, first, last + 1);
  const cells = Array.from(late.states[0].deviceCells);
  const nearer = cells.every(
    (cell, k) =>
      given[k] < ENOUGH || far(ahead, 0, undefined, cell) < far(late, first, first + 1, cell),
  );
  if (!nearer || !(mean >= (2 * sum(hears)) / hears.length)) return null;
  const hidden = environment.meanSnrDb
    ? []
    : [...cells.keys()].filter((k) => given[k] >= ENOUGH && !environment.isSeen(cells[k]));
  const sealed = 2 * sum(hidden.map((k) => given[k])) > sum(given) ? hidden : [];
  return {
    kind: "waits",
    first,
    last,
    least: Math.min(...hears),
    most: Math.max(...hears),
    sealed,
    mean,
    look: first,
  };
}

/** The devices where data is left while a flight goes nowhere, if all of them are sealed in. Over a real place, walls are not the cause. */
function sealedLeft(flight, { stretches, hovers }, environment) {
  if (!hovers || environment.meanSnrDb) return [];
  const has = ([step]) =>
    [...leftAt(flight, step).keys()].filter((k) => leftAt(flight, step)[k] >= NONE);
  const hidden = has(stretches[0]).every(
    (k) => !environment.isSeen(flight.states[0].deviceCells[k]),
  );
  return hidden ? has(stretches.at(-1)) : [];
}

/** The first step of the way home, from which each step leads nearer to the landing, or on over the landing zone. */
export function turnsHome({ uavCell, action }, timeToLand) {
  const home = (k) => timeToLand[uavCell[k]];
  const goes = (k) =>
    home(k + 1) < home(k) || (home(k) === 1 && home(k + 1) === 1 && uavCell[k + 1] !== uavCell[k]);
  let step = action.length - 1;
  while (step > 0 && goes(step - 1)) step -= 1;
  return step;
}

/**
 * For two that bring about as much home, but not in the same time, after which `step` each has `all`, or which is the last to bring
 * LITTLE or more; from which device that comes, how far `home` is then, and `after` how many steps it lands. Else null.
 */
function lasts(who, flights, timeToLand) {
  const [first, second] = flights.map(({ dataLeft }) => sum(dataLeft.at(-1)));
  if (
    !flights.every(({ landed }) => landed) ||
    Math.abs(first - second) >= ENOUGH ||
    flights[0].action.length === flights[1].action.length
  )
    return null;
  const ends = flights.map((flight, k) => {
    const all = emptied(flight) >= 0;
    const step = all ? emptied(flight) : idle(flight).slice(0, -1).lastIndexOf(false) + 1;
    const given = givenBy(flight, step - 1, step);
    return {
      who: who[k],
      all,
      step,
      device: given.indexOf(Math.max(...given)),
      home: timeToLand[flight.uavCell[step]],
      after: flight.action.length - step,
    };
  });
  return ends.every(({ step }) => step > 0) ? ends : null;
}

/** Who has collected ENOUGH more before a step, and how much more it is at the end, null while one is in the air. */
function aheadAt(who, flights, step) {
  const more = (at) => sum(flights[1].dataLeft.at(at)) - sum(flights[0].dataLeft.at(at));
  const sign = Math.sign(more(step));
  const over = flights.every(({ landed, timeLeft }) => landed || timeLeft.at(-1) <= 0);
  return Math.abs(more(step)) < ENOUGH
    ? null
    : { who: who[sign > 0 ? 0 : 1], amount: sign * more(step), end: over ? sign * more(-1) : null };
}

/** The step after which nothing is left to collect, if its first idle stretch comes later; else 0. */
function nothingSince(flight) {
  const since = emptied(flight);
  return since > 0 && since <= (astray(flight).stretches[0]?.[0] ?? -1) ? since : 0;
}

/** The first step before which all is collected, −1 if there is none. */
export const emptied = ({ dataLeft }) => dataLeft.findIndex((each) => sum(each) < NONE);

/** What a flight gets from a device from the `first` to the `last` step that bring LITTLE or more, or, if none does, in all. */
function got(flight, device) {
  const brings = Array.from(flight.action, (_, k) => givenBy(flight, k, k + 1)[device] >= LITTLE);
  const [first, last] = [brings.indexOf(true), brings.lastIndexOf(true)];
  return {
    amount: givenBy(flight, Math.max(first, 0), last < 0 ? -1 : last + 1)[device],
    first,
    last,
  };
}

/** How many steps bring LITTLE or more and how many do not, without a landing. */
function spentBy(flight) {
  const count = idle(flight).filter((each) => each).length;
  return { brings: flight.action.length - Number(flight.landed) - count, idle: count };
}

const acted = (flight, step) => ({
  action: ACTIONS[flight.action[step]],
  refused: Boolean(flight.intervened[step]),
});

/** For each step whether it brings hardly any data; a landing is none of these. */
export function idle(flight) {
  const total = flight.dataLeft.map(sum);
  const lands = (k) => flight.action[k] === LAND && !flight.intervened[k];
  return Array.from(flight.action, (_, k) => total[k] - total[k + 1] < LITTLE && !lands(k));
}

/** The stretches, each from a first to a last step, in which something holds. */
function stretchesOf(count, holds) {
  const stretches = [];
  for (let k = 0; k < count; k += 1) {
    if (!holds(k)) continue;
    if (stretches.at(-1)?.[1] === k - 1) stretches.at(-1)[1] = k;
    else stretches.push([k, k]);
  }
  return stretches;
}

/**
 * The idle steps that stay where it is or lead to and fro, as `stretches` from a step to a last one, LONG steps
 * or more, and how many of their steps are `hovers` and `turns`.
 */
export function astray(flight) {
  const cells = flight.uavCell;
  const turns = (k) => k >= 0 && k + 2 < cells.length && cells[k + 2] === cells[k];
  const hovers = (k) => cells[k + 1] === cells[k];
  const idles = idle(flight);
  const stretches = stretchesOf(
    idles.length,
    (k) => idles[k] && (hovers(k) || turns(k) || turns(k - 1)),
  );
  const long = stretches.filter(([first, last]) => last - first + 1 >= LONG);
  const steps = long.flatMap(([first, last]) =>
    Array.from({ length: last - first + 1 }, (_, k) => first + k),
  );
  return {
    stretches: long,
    hovers: steps.filter(hovers).length,
    turns: steps.filter((k) => !hovers(k)).length,
  };
}

/** What is left at each device after a number of steps, or at the end. */
const leftAt = ({ dataLeft }, step) => dataLeft[step] ?? dataLeft.at(-1);
const givenBy = (flight, step, by) =>
  Array.from(leftAt(flight, step), (each, k) => each - leftAt(flight, by)[k]);

/** The step by which a device has given much since another; −1 if none does. */
const muchSince = (flight, step) =>
  flight.dataLeft.findIndex((_, by) => by > step && Math.max(...givenBy(flight, step, by)) >= MUCH);

/** The device that gives most up to the step `by`, where it is much, and what each gives, or whether it goes straight home. */
function towards(flight, step, by) {
  const given = by > 0 ? givenBy(flight, step, by) : [];
  if (muchSince(flight, step) > 0) return { device: given.indexOf(Math.max(...given)), by, given };
  const way = Array.from(flight.uavCell.slice(step, -1)); // without the step that lands
  const home = flight.landed && way.length > 1 && new Set(way).size === way.length;
  return { by, given: home ? [] : given, home };
}

/** Whether flights with these results are the duel that was asked for: 1, −1 or, level, 0. */
export function isDuel(wanted, results, part) {
  if (!results.some(({ landed }) => landed)) return false;
  return wanted
    ? wins(...(wanted > 0 ? results : results.toReversed()))
    : Math.abs(lead(results)) < LEVEL && part !== null;
}
