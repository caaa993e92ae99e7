// What a recorded training shows: where it learned to land, and in words how a race of two went.

import { RUNS, grouped, upper } from "./words.js";

const FOR_GOOD = 0.5; // of the missions of a point and of all later ones: it has learned to land
const FALL = 5; // per cent of the data that it brings home less at the next point: worth a word

/** The point from which on half of the missions or more land, or null. */
export function kinkOf({ points }) {
  const fails = points.findLastIndex(({ landed }) => landed < FOR_GOOD);
  return fails >= 0 && fails + 1 < points.length ? fails + 1 : null;
}

/** What the missions of a point brought, as a fact. */
export function pointFact(
  { steps, landed, collected_and_landed: home, time_used: time },
  episodes,
) {
  const [brought, used] = [home, time].map((share) => Math.round(100 * share));
  return {
    kind: "point",
    episodes,
    steps,
    landed: Math.round(episodes * landed),
    home: brought,
    time: used,
  };
}

/**
 * What the kinks mean, and how the runs ended: facts; `at` are the points that one names.
 * @param {{points: {steps: number, landed: number, collected_and_landed: number, time_used: number}[]}[]} runs one or two
 * @param {string} metric that the curves show
 */
export function raceFacts(runs, episodes, metric) {
  const facts = [];
  runs.forEach((run, k) => {
    const kink = kinkOf(run);
    const points = run.points.map((point) => pointFact(point, episodes));
    const about = { run: k, episodes };
    if (kink === null)
      facts.push({
        kind: run.points.at(-1).landed >= FOR_GOOD ? "fromTheStart" : "never",
        ...about,
      });
    else {
      facts.push({
        kind: "kink",
        ...about,
        at: [kink],
        steps: points[kink].steps,
        before: points[kink - 1].landed,
        now: points[kink].landed,
      });
      const best = points
        .slice(0, kink)
        .reduce((one, other) => (other.landed > one.landed ? other : one));
      if (best.landed >= FOR_GOOD * episodes)
        facts.push({
          kind: "forgot",
          ...about,
          at: [points.indexOf(best)],
          steps: best.steps,
          landed: best.landed,
        });
    }
    const falls = points
      .slice(1)
      .map((to, before) => ({
        at: [before, before + 1],
        from: points[before],
        to,
        by: points[before].home - to.home,
      }));
    const most = falls.reduce((one, other) => (other.by > one.by ? other : one));
    const { at, from, to } = most;
    const sooner = to.landed >= from.landed && from.time - to.time >= FALL;
    if (most.by >= FALL)
      facts.push({ kind: "falls", ...about, at, from, to, sooner, hidden: metric === "landed" });
  });
  const [blue, orange] = runs.map((run) => run.points[kinkOf(run)]?.steps);
  if (blue && orange && blue !== orange)
    facts.push({ kind: "sooner", run: Number(orange < blue), steps: Math.abs(blue - orange) });
  const ends = runs.map(({ points }) => pointFact(points.at(-1), episodes));
  const [first, second] = ends.map(({ home }) => home);
  const level = runs.length < 2 || Math.abs(first - second) <= 1;
  facts.push({ kind: "ends", episodes, ends, wins: level ? null : Number(second > first) });
  return facts;
}

const TEMPLATES = {
  fromTheStart: ({ run }) => `${upper(RUNS[run])} lands from the start.`,
  never: ({ run }) => `${upper(RUNS[run])} has not learned to land for good.`,
  kink: ({ run, steps, before, now, episodes }) =>
    `${upper(RUNS[run])} learns to land for good at its dashed line, after ${grouped(steps)} steps: ${before} of ${episodes} missions landed at the point before, ${now} at this one.`,
  forgot: ({ steps, landed }) =>
    `Earlier, after ${grouped(steps)} steps, ${landed} landed, but it forgot how.`,
  falls({ run, from, to, sooner, episodes, hidden }) {
    const lands =
      to.landed === from.landed
        ? "it lands as often"
        : `it lands in ${to.landed} of ${episodes} missions, not in ${from.landed}`;
    const time = `its flights take ${to.time}\u00a0% of their time, not ${from.time}\u00a0%`;
    const less =
      to.landed < from.landed
        ? ""
        : sooner
          ? `, but ${time}`
          : `, but collects less in ${to.time > from.time + 5 ? "more" : "about the same"} time; why, this record does not tell: press both numbers of steps to see the agents fly`;
    return (
      `After ${grouped(from.steps)} steps ${RUNS[run]} brings ${from.home}\u00a0% of the data home, but after ${grouped(to.steps)} only ` +
      `${to.home}\u00a0%, its deepest fall${sooner ? ", because it goes home sooner" : ""}: ${lands}${less}${hidden ? " (choose “collected and landed” to see it)" : ""}.`
    );
  },
  sooner: ({ run, steps }) => `${upper(RUNS[run])} learns to land ${grouped(steps)} steps sooner.`,
  point: ({ episodes, landed, home }) =>
    `Over ${episodes} missions that it did not learn from, it lands in ${landed} and brings ${home}\u00a0% of the data home.`,
  ends({ ends, wins, episodes }) {
    const told = ends.map(
      ({ landed, home }, k) =>
        `${RUNS[k]} lands in ${landed} of ${episodes} missions and brings ${home}\u00a0% of the data home`,
    );
    return `${wins === null ? "In the end" : `${upper(RUNS[wins])} wins`}: ${told.join("; ")}.`;
  },
};
export const sentence = (fact) => TEMPLATES[fact.kind](fact);
