// What a recorded training shows: where it learned to land, and in words how a race of two went.

const FOR_GOOD = 0.5; // of the missions of a point and of all later ones: it has learned to land

/** The point from which on half of the missions or more land, or null. */
export function kinkOf({ points }) {
  const fails = points.findLastIndex(({ landed }) => landed < FOR_GOOD);
  return fails >= 0 && fails + 1 < points.length ? fails + 1 : null;
}

/**
 * What the kinks mean, and how the runs ended: facts.
 * @param {{points: {steps: number, landed: number, collected_and_landed: number}[]}[]} runs one or two
 */
export function raceFacts(runs, episodes) {
  const facts = [];
  const landed = (point) => Math.round(episodes * point.landed);
  runs.forEach((run, k) => {
    const kink = kinkOf(run);
    const { points } = run;
    const about = { run: k, episodes };
    if (kink === null) {
      facts.push({ kind: points.at(-1).landed >= FOR_GOOD ? "fromTheStart" : "never", ...about });
      return;
    }
    facts.push({ kind: "kink", ...about, steps: points[kink].steps, before: landed(points[kink - 1]), now: landed(points[kink]) });
    const best = points.slice(0, kink).reduce((one, other) => (other.landed > one.landed ? other : one));
    if (best.landed >= FOR_GOOD) facts.push({ kind: "forgot", ...about, steps: best.steps, landed: landed(best) });
  });
  const ends = runs.map(({ points }) => ({
    landed: landed(points.at(-1)),
    home: Math.round(100 * points.at(-1).collected_and_landed),
  }));
  const [first, second] = ends.map(({ home }) => home);
  const level = runs.length < 2 || Math.abs(first - second) <= 1;
  facts.push({ kind: "ends", episodes, ends, wins: level ? null : Number(second > first) });
  return facts;
}
