// Sentences from facts. A fact is a small record: who, what, where, when, how much. A template makes
// a sentence of it, so that what is said can be tested without reading English.

/**
 * @typedef {object} Who somebody that flies, as data
 * @property {string} name of the policy
 * @property {string} title as in a table: `DDQN agent`
 * @property {string} subject as in a sentence: `the DDQN agent`
 * @property {boolean} you whether it is the reader, whose verbs have no s
 * @property {boolean} [thinks] whether it is an agent, which the tool Think shows
 */

const IRREGULAR = {
  has: "have",
  goes: "go",
  crashes: "crash",
  flies: "fly",
  hovers: "hover",
  is: "are",
};

/** A verb in the person of its subject: `who("flies")` or, of the reader, `you fly`. */
export const says = ({ subject, you }, verb, rest = "") =>
  `${subject} ${you ? (IRREGULAR[verb] ?? verb.replace(/s$/, "")) : verb}${rest && ` ${rest}`}`;
export const upper = (text) => text.slice(0, 1).toUpperCase() + text.slice(1);
export const units = (amount) =>
  amount >= 0.1 || amount === 0 ? amount.toFixed(1) : amount.toPrecision(1);
export const signed = (value) => (value <= -0.05 ? "−" : "") + Math.abs(value).toFixed(1);
export const grouped = (number) => number.toLocaleString("en");
export const RUNS = ["blue", "orange"]; // the runs of a race by their colours
export const NAME = 40; // letters of a city's name, at most
export const LONGEST = 500; // units of time that a mission of this page has at most
export const gapOf = (gap) =>
  gap < 0.005 ? "less than 0.01" : gap >= 1 ? gap.toFixed(1) : gap.toFixed(2);
const steps = (count) => (count === 1 ? "1 step" : `${count} steps`);
export const timeUnits = (count) => `${count} ${count === 1 ? "unit" : "units"} of time`;
const listed = (all) =>
  all.length > 1 ? `${all.slice(0, -1).join(", ")} and ${all.at(-1)}` : all[0];
const lost = ({ hovers, turns }) =>
  [hovers && "hovering", turns && "flying to and fro"].filter((each) => each).join(" or ");
const during = ({ stretches }) =>
  `steps ${listed(stretches.map(([first, last]) => `${first + 1}–${last + 1}`))}`;
const fromTo = (first, last) =>
  last > first ? `from step ${first + 1} to ${last + 1}` : `in step ${first + 1}`;

/** What somebody does in a step: `{ who, action, refused }`. */
function act({ who, action, refused }) {
  if (refused)
    return says(who, "is", `refused the ${action === "land" ? "landing" : `move ${action}`}`);
  return (
    { hover: says(who, "hovers"), land: says(who, "lands") }[action] ?? says(who, "flies", action)
  );
}

/** What comes of a step: all that it brings up to the step `by`, or that it leads home. */
function towards({ by, given = [], home, who }, step) {
  const shown = given
    .map((amount, device) => [amount.toFixed(1), device])
    .filter(([amount]) => Number(amount))
    .sort(([one], [other]) => other - one);
  if (!shown.length) return home ? ` and ${who.you ? "go" : "goes"} home` : "";
  const all = shown.reduce((total, [amount]) => total + Number(amount), 0).toFixed(1); // adds up as it is shown
  const parts = shown.map(([amount, device]) => `${amount} from device ${device}`).join(", ");
  const when = by > step + 1 ? `by step ${by}` : "in this step";
  return ` and ${who.you ? "get" : "gets"} ${shown.length > 1 ? `${all} units ${when} (${parts})` : `${all} units from device ${shown[0][1]} ${when}`}`;
}

const homeSooner = (sooner) => `home ${steps(Math.abs(sooner))} ${sooner > 0 ? "sooner" : "later"}`;
/** What somebody has gained who is ahead with no less data. */
const gained = ({ more, sooner, refusals }) =>
  [
    more && `${more.toFixed(1)} units more`,
    sooner && homeSooner(sooner),
    refusals && "fewer refusals",
  ]
    .filter(Boolean)
    .join(", ") || "fewer refusals";
const sealedIn = (devices) =>
  `${listed(devices.map((device) => `device ${device}`))} ${devices.length > 1 ? "are" : "is"} sealed in: ` +
  `${devices.length > 1 ? "they" : "it"} cannot be seen from any cell that the UAV can reach`;

const unseen = ({ sealed = [] }) =>
  sealed.length
    ? `, when data is left only at ${listed(sealed.map((device) => `device ${device}`))}, ` +
      `${sealed.length > 1 ? "all" : "which is"} sealed in: seen from no cell that the UAV can reach`
    : "";

/** A sentence for each kind of fact. Steps are counted from 0 in facts and from 1 in sentences. */
const TEMPLATES = {
  air: () => "One flight is still in the air.",
  empty: () => "One flight has not begun: fly it in the tool Fly.",
  level({ who, data, more, sooner }) {
    if (!who) return "Nearly level.";
    const home = sooner && homeSooner(sooner);
    const is = who.you ? "are" : "is";
    if (!more)
      return `Nearly level: both bring ${data.toFixed(1)} units${home ? `, and ${says(who, "is", home)}` : " in the same time"}.`;
    return `Nearly level: ${says(who, "brings", `${units(more)} units more`)}${home ? `, ${sooner > 0 ? "and" : "but"} ${is} ${home}` : ""}.`;
  },
  crashes: () => "Both crash, because the time runs out: no data is brought home.",
  crash: ({ who, other }) =>
    `${upper(says(who, "wins"))}, because the time runs out before ${says(other, "lands")}: ${other.you ? "your" : "its"} data is lost.`,
  wins: (fact) => `${upper(says(fact.who, "wins"))}: ${gained(fact)}.`,
  ahead(fact) {
    const { who, more, sooner, by, refusals } = fact;
    const leads = `${upper(says(who, "is", `ahead by ${by.toFixed(1)}`))} in return`;
    if (more >= 0) return `${leads}: ${gained(fact)}.`;
    const they = { ...who, subject: who.you ? "you" : "it" };
    const why = refusals ? "fewer actions are refused" : says(they, "is", homeSooner(sooner));
    return `${leads}, although ${says(they, "brings", `${(-more).toFixed(1)} units less`)}, because ${why}.`;
  },
  end: ({ verdict: { kind, who } }) =>
    ({ level: "Nearly level", crashes: "Both crash" })[kind] ??
    upper(kind === "ahead" ? says(who, "is", "ahead") : says(who, "wins")),
  same: ({ step }) =>
    step < 0
      ? "Both fly the same way."
      : `They first act differently at step ${step + 1}, but end at the same time in the same cell, with about the same data.`,
  part: ({ step, acts, ends }) =>
    `At step ${step + 1}, ${acts.map((each, k) => act(each) + (ends ? towards(ends[k], step) : "")).join(", while ")}.`,
  first({ step, near, part, ahead }) {
    const { who, amount, end } = ahead ?? {};
    const later =
      end === null
        ? ""
        : `, in the end ${Math.abs(end) < 0.05 ? "as much" : `${units(Math.abs(end))} ${end < 0 ? "less" : "more"}`}`;
    const has = ahead
      ? `; before step ${part + 1} ${says(who, "has", `collected ${units(amount)} units more${later}`)}`
      : "";
    return `They first act differently at step ${step + 1}, but ${near ? `stay near each other until step ${part + 1}` : "come near each other again"}${has}.`;
  },
  ways: ({ step }) =>
    `From step ${step + 1} on they fly different ways, but get about as much from each device.`,
  shadow({ who, other, device, first, last, rates: [hears, would], amounts }) {
    const [some, others] = amounts.map((amount) =>
      amount < 0.05 ? "hardly anything" : `${amount.toFixed(1)} units`,
    );
    return (
      `${upper(fromTo(first, last))}, ${says(who, "is", `in the radio shadow of device ${device}`)}: buildings leave ${units(hears)} of ${units(would)} units a slot ` +
      `there. ${upper(says(other, "sees", "the device"))} in ${last > first ? "these steps" : "this step"} and ` +
      `${other.you ? "get" : "gets"} ${others} from it, ${who.subject} ${some}.`
    );
  },
  waits({ who, other, first, last, least, most, sealed, mean }) {
    const rates = [...new Set([least, most].map(units))].join("–");
    return (
      `${upper(says(who, "hovers"))} ${fromTo(first, last)}, for ${rates} units a step${sealed.length ? `, because ${sealedIn(sealed)}` : ""}; ${says(other, "flies", "nearer to the devices")} and ` +
      `${other.you ? "get" : "gets"} ${units(mean)} on average in each step that brings data.`
    );
  },
  idles: ({ idlers }) =>
    `${upper(idlers.map((each) => says(each.who, "spends", `${during(each)} ${lost(each)}${unseen(each)}`)).join("; "))}; none of these steps brings 0.1 units.`,
  spends({ who, spent, other, others, since, ...astray }) {
    const does = lost(astray);
    const where = does && `, ${does} in ${during(astray)}`;
    return (
      `Apart from landing, ${says(who, "takes", `${steps(spent.brings)} that ${spent.brings === 1 ? "brings" : "bring"} 0.1 units or more`)} ` +
      `and ${spent.idle} that ${spent.idle === 1 ? "does" : "do"} not` +
      `${where}${since ? `, though ${nothingLeft(since)}` : unseen(astray)}; ${says(other, "takes", `${others.brings} and ${others.idle}`)}.${does && who.thinks ? " Think shows what it expected there." : ""}`
    );
  },
  leaves({ devices, unused, used, turns, loser, winner }) {
    const left = devices.map(
      ({ device, more }, k) =>
        `${Math.abs(more).toFixed(1)} ${k ? "" : "units "}${more > 0 ? (k ? "" : "more ") : "less "}at device ${device}`,
    );
    const home = turns
      ? `: ${says(loser.who, "turns", `home at step ${turns[0] + 1}`)}, ${winner.who.subject} at step ${turns[1] + 1}`
      : "";
    const collects = ({ who, amount, first, last }) =>
      says(
        who,
        "collects",
        amount < 0.1
          ? "less than 0.1 units"
          : `${amount.toFixed(1)} units${first < 0 ? ", but less than 0.1 in each step" : ` ${fromTo(first, last)}`}`,
      );
    const expected =
      turns && loser.who.thinks ? `Think shows what it expected at step ${turns[0] + 1}. ` : "";
    return (
      `In the end ${says(loser.who, "leaves", listed(left))}${unused ? `, with ${timeUnits(unused)} unused` : used ? ", with all its time used" : ""}${home}. ${expected}` +
      `At device ${devices[0].device}, ${collects(winner)}; ${collects(loser)}.`
    );
  },
  lasts({ ends }) {
    const told = ({ who, all, step, device, home, after }) =>
      `${all ? says(who, "has", `everything after step ${step}, the last of it`) : says(who, "collects", `0.1 units or more for the last time in step ${step},`)} ` +
      `from device ${device}, ${steps(home)} from home${after > home ? `, and ${who.you ? "land" : "lands"} ${steps(after)} later` : ""}`;
    return `${upper(ends.map(told).join("; "))}.`;
  },
  rule: ({ ahead, sooner, level }) =>
    `A win here is a lead of more than ${ahead} in return with no less data: about ${ahead} units more, or home ` +
    `${sooner} steps sooner. Nearly level is less than ${level} apart.`,
  none: ({ who, missions }) =>
    `${who ? says(who, "wins", "none") : "none"} of the next ${missions} missions here${who ? "" : " is nearly level"}: ` +
    `press it again to look at ${missions} more, or try another city or other rivals`,

  // What an agent does in a step, and why
  chooses({ action, reason, gap, second, close, both }) {
    const why = reason ? REASONS[reason.kind](reason) : "";
    if (gap === null) return `${action}, because nothing else leaves time to land.`;
    return `${action}${why}; ${close ? "a close call: " : ""}${gapOf(gap)} ahead of ${second}${both ? comparison(both, second) : ""}.`;
  },

  missed({ step, left, least, none, could, fades }) {
    const from = `It leaves ${units(left)} units behind. From step ${step + 1} on,`;
    const still = fades ? ", without fading" : "";
    if (none)
      return `${from} no flight home in time could collect ${least} units of them beyond what its extra steps cost${still}.`;
    if (!could)
      return `${from} this page finds no flight home in time that collects ${least} units of them beyond what its extra steps cost, but there may be one.`;
    const devices = listed(could.devices.map((device) => `device ${device}`));
    return `${from} it could still collect ${units(could.amount)} of them from ${devices} and be home in time, in ${steps(could.steps)}${still}.`;
  },

  place: ({ source, licence }) =>
    "A real place. In flights over it a table of traced rays says how well the UAV hears each device; there is no fading, and where " +
    "no ray arrives, nothing is heard. Shadows and the tool Channel show the paper's model, which is also what agents are told. " +
    `Traced with Sionna RT; source: ${source}, ${licence}`,

  // How a race of recorded trainings went
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

  // What happened beside what was asked for
  moved: ({ moved }) =>
    `What stood there has moved: ${listed(moved.map(({ thing, cell: [row, col] }) => `${thing} to row ${row}, column ${col}`))}.`,
  strangers: ({ strangers, who, city }) =>
    `${listed(strangers.map((name) => `“${name}”`))} cannot fly over ${city} on this page, so ${listed(who.map(({ subject }) => subject))} do.`,
  twice: ({ who }) =>
    `A rival cannot fly against itself, so ${listed(who.map(({ subject }) => subject))} do.`,
  opened: ({ file }) => `${file} is open.`,
  saved: ({ file }) => `Saved as ${file}.`,
  grounded: ({ moves }) =>
    `Your flight of ${steps(moves)} belongs to the mission before this change: ↶ brings both back.`,
  others: ({ file }) => `Only ${file} was opened: open one file at a time.`,

  // What is odd about a mission or a city
  absent: ({ absent }) =>
    `${upper(listed(absent))} ${absent.length > 1 ? "were" : "was"} not trained for this city, and cannot fly here.`,
  outside: () => "This mission starts outside the landing zone; random missions start in it.",
  sealed: ({ cells, where: [row, col] }) =>
    `No way leads from the landing zone to ${cells === 1 ? "" : `${cells} cells of this city, such as `}row ${row}, column ${col}.`,
  unreachable: ({ device }) => `No way leads to device ${device}: it can only be heard from afar.`,
  unheard: ({ device, traced }) =>
    `${upper(sealedIn([device]))}, ${
      traced?.amount >= 0.1
        ? `but by the traced rays it is heard all the same, best over row ${traced.where[0]}, column ${traced.where[1]}: ${units(traced.amount)} units a slot.`
        : "and what comes through the walls is little."
    }`,
  late: ({ time, home }) =>
    home > 9999
      ? "No way leads from the start to a landing zone."
      : home === time
        ? `In a flying time of ${time}, it can only ${time > 1 ? "fly home" : "land"}.`
        : `A flying time of ${time} is too short: the way home alone takes ${home}.`,
  bare: ({ devices }) =>
    `${upper(listed(devices.map((device) => `device ${device}`)))} ${devices.length > 1 ? "have" : "has"} no data: nothing is to be had there.`,
};

const nothingLeft = (since) =>
  since ? `nothing has been left to collect since step ${since}` : "all data is collected";

const REASONS = {
  refused: () => ", which is refused: it stays where it is, which costs 1 of the return",
  idle: ({ since }) => `, though ${nothingLeft(since)}`,
  stays: ({ until, amount, rest }) =>
    `, which ${until ? `up to step ${until} ` : ""}brings ${amount < 0.05 ? "hardly any" : amount.toFixed(1)} of the ${rest.toFixed(1)} units that are left`,
  done: ({ since }) => `, because ${nothingLeft(since)}`,
  home: ({ home, left, now }) =>
    now
      ? `, because home is ${timeUnits(home)} away and ${left} ${left === 1 ? "is" : "are"} left`
      : `, on the way home, which is ${timeUnits(home)} away; ${left} are left`,
  back: () => ", back to where it just was",
  gives({ device, amount, all, within, waits, back, home }) {
    const [some, total] = [amount, all].map((each) => each.toFixed(1));
    if (within > 1)
      return `, ${waits ? "waiting for" : "on the way to"} device ${device}, which gives ${some} units within ${within} steps`;
    const gives = `gives ${some} ${some === total ? "" : `of ${total} `}units in this step`;
    return `, because device ${device} ${gives}${back ? ", back to where it just was" : ""}${home ? ", on the way home" : ""}`;
  },
};

/** What the second best action would bring in the same step as the best, and if that is no less, what else speaks against it and for it. */
function comparison({ brings, instead, over, home, hidden, seen, costs, alone }, second) {
  const [here, there] = [brings, instead].map((each) => each.toFixed(1));
  if (Number(there) < Number(here))
    return `, which would bring ${there} units in this step, not ${here}${costs < 0 ? ", but would cost 1 less" : ""}`;
  const sight = (all, how) =>
    all.length &&
    `${listed(all.map((device) => `device ${device}`))} ${all.length > 1 ? "are" : "is"} ${how}`;
  const way = (how) => `the way home is ${steps(Math.abs(home))} ${how}`;
  const said = (mark, ...told) => told.filter(Boolean).join(mark);
  const after = (...told) => told.some(Boolean) && `after ${second} ${said(" and ", ...told)}`;
  const against = over
    ? after("the flight is over")
    : said(
        ", and ",
        after(home > 0 && way("longer"), sight(hidden, "hidden")),
        costs > 0 && `${second} would be refused, which costs 1`,
      );
  const likes = over
    ? ""
    : said(
        ", and ",
        costs < 0 && `${second} would cost 1 less`,
        after(home < 0 && way("shorter"), sight(seen, "in sight")),
      );
  const more = Number(there) > Number(here);
  const end = against
    ? `, but ${against}${likes && `; on the other hand, ${likes}`}`
    : likes
      ? alone
        ? `, and ${likes}: the network misjudges this`
        : `, though ${likes}`
      : more
        ? ""
        : `: this page cannot tell why ${second} is behind`;
  return `${there === "0.0" ? "; neither brings anything to speak of in this step" : `, which would bring ${more ? "more" : "as much"} in this step, ${there} units`}${end}`;
}

/** The sentence of a fact. */
export const sentence = (fact) => TEMPLATES[fact.kind](fact);
