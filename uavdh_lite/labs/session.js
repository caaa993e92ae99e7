// A session: it hears what is done on the page, and says what is to be drawn. It runs in a worker, so
// that no computation stops the drawing.

import { hiddenRows, ledger } from "./channel.js";
import { RULE, isDuel, lead, parting, reasons, verdict } from "./compare.js";
import { Hangar, filmOf, numbers, warnings, whoIs } from "./flights.js";
import { bytesOf, readAgent, valueMap } from "./pilots.js";
import { kinkOf, pointFact, raceFacts } from "./race.js";
import {
  CHANGES,
  LOOKS,
  TOOLS,
  YOU,
  cityOfPicture,
  isInside,
  newStage,
  overCity,
  pictureOf,
  pointOf,
  randomMission,
  readFile,
  stageAsJson,
  textOfLink,
  withMission,
} from "./state.js";
import { choices, closestCall, missed } from "./think.js";
import {
  ACTIONS,
  City,
  InputError,
  SIGNS,
  bootstrapInterval,
  kept,
  require,
  wilsonInterval,
} from "./world.js";
import { LONGEST, NAME, RUNS, grouped, sentence, upper } from "./words.js";

const TOGETHER = 700; // ms between changes of one kind that are undone as one
const KEPT = 100; // changes and moves that can be undone
const RANKED = 6; // flights of the ranking
const MISSIONS = 100;
const TRIES = 200; // missions that are looked at for a duel
const FIRST = 1_000_000; // the number of the first of the hundred missions: "New" does not come so far
const STORY = 358; // the mission that the page begins with, chosen because it shows a difference
const RACED = 13; // the mission of Watch, chosen because there each agent brings about what it brings on average
const TURN = 50; // ms of a computation after which others have their turn
const EMPTY = [8, 12, 16]; // cells on a side of cities that are still to be painted
const BESIDE = ["show", "values", "shadow", "look", "hold", "see"]; // no action of the reader, in any tool
const GO_ON = [...BESIDE, "tool", "save"]; // what does not end what takes long
const INSTEAD = ["cancel", "many", "duel"]; // what ends it on purpose
const ELSEWHERE = ["new", "city", "duel", "race", "open"]; // what shows quite another mission
const LETTERS = 60; // of a word that was found in a file
const STOPPED = new InputError("stopped");

const isCell = (value) =>
  Array.isArray(value) && value.length === 2 && value.every(Number.isInteger);
const isHere = (value, { stage }) => isInside(value, stage.mission.city.size);
const isDevice = (value, { stage }) =>
  Number.isInteger(value) && value >= 0 && value < stage.mission.devices.length;
const isOf =
  (...values) =>
  (value) =>
    values.includes(value);

/** What the page may tell: the entries that each kind of message needs, and what fits, `(value, session, message)`. */
const MESSAGES = {
  again: {},
  cancel: {},
  many: {},
  new: {},
  add: { cell: isCell },
  city: { name: (name, { cities }) => cities.includes(name) },
  data: { device: isDevice, value: Number.isFinite },
  duel: { wanted: isOf(-1, 0, 1) },
  fly: { action: isOf(...ACTIONS) },
  hold: { cell: (cell, session) => cell === null || isHere(cell, session) },
  look: { device: isDevice },
  move: { device: (device, session) => device === -1 || isDevice(device, session), cell: isCell },
  open: {
    file: (file, session, { link }) =>
      file instanceof File || (typeof link === "string" && link !== ""),
  },
  paint: {
    cells: (cells, session) => Array.isArray(cells) && cells.every((cell) => isHere(cell, session)),
    sign: isOf(...SIGNS),
  },
  policy: {
    which: isOf(0, 1),
    name: (name, { stage, known }) => [...known(stage.mission.city), YOU].includes(name),
  },
  race: { point: (point, { stage, shelf }) => pointOf(stage.looks, point, shelf) },
  remove: { device: isDevice },
  save: { what: isOf("stage", "mission", "png") },
  see: {
    name: (name) => Object.hasOwn(LOOKS, name),
    value: (value, { shelf }, { name }) => LOOKS[name](value, shelf),
  },
  shadow: { cell: isHere },
  show: { step: (step) => Number.isInteger(step) && step >= -1 },
  time: { value: Number.isFinite },
  tool: { tool: (tool, { tools }) => tools.includes(tool) },
  undo: { by: isOf(-1, 1) },
  values: { step: (step) => Number.isInteger(step) && step >= 0 },
};

/** Why something was not done, for people; nothing if they ended it themselves. */
function reasonOf(error) {
  const short = (word) => (word.length > LETTERS ? `${word.slice(0, LETTERS)}…` : word);
  if (error instanceof InputError)
    return error === STOPPED ? "" : error.message.replace(/\S+/g, short);
  console.error(error);
  return `this did not work: ${error}`;
}

/**
 * An agent that is read from its bytes when it is first needed.
 * @param {City | null} of the city that it was made for; null if for all up to its size
 */
function shelved(
  {
    title,
    given = false,
    subject = `the ${given ? "agent " : ""}${title}`,
    size,
    scores,
    base64,
    read,
  },
  of,
) {
  const knows = (city) => (of ? of.sameAs(city) : city.size <= size);
  return {
    title,
    subject,
    scores,
    given,
    of,
    knows,
    get agent() {
      return (read ??= readAgent(bytesOf(base64)));
    },
  };
}

/** An agent of a file that the reader opened. */
const givenAgent = (name, read) =>
  shelved(
    {
      title: name,
      size: read.size,
      scores: read.recipe.kind === "ImitationRecipe",
      given: true,
      read,
    },
    read.city,
  );

export class Session {
  /**
   * @param {object} data what the page holds: `cities` with rows and scenario, and a table if they are real places, `agents` with title and
   *   base64, `colours` of devices, recorded `races`; where it begins elsewhere than with the story, a `mission` or a `tool` alone
   * @param {(told: object) => void} post takes what the page is told
   */
  constructor(data, post) {
    Object.assign(this, {
      data,
      post,
      at: 0,
      last: ["", 0],
      extra: {},
      ranking: [],
      notes: [],
      past: [],
    });
    const [cities, scenarios] = [{}, {}];
    for (const { name, rows, scenario } of data.cities) {
      cities[name] = City.fromText(name, rows.join("\n"));
      scenarios[name] = scenario;
    }
    for (const size of EMPTY) {
      const rows = Array.from({ length: size }, (_, r) => (r < 2 ? "LL" : "").padEnd(size, "."));
      cities[`empty ${size} × ${size}`] = City.fromText(`empty ${size} × ${size}`, rows.join("\n"));
    }
    this.places = data.cities.filter(({ gain }) => gain);
    const races = data.races?.settings ?? [];
    const tools = TOOLS.filter((tool) => tool !== "watch" || races.length);
    this.shelf = {
      cities,
      scenarios,
      known: this.known,
      races,
      tools,
      village: cities[data.races?.city],
    };
    this.agents = {};
    for (const each of data.agents)
      this.agents[each.name] = shelved(each, cities[each.city] ?? null);
    this.tools = data.tool ? [data.tool] : tools;
    const first = data.mission
      ? readFile(JSON.stringify(data.mission), this.shelf)
      : newStage(randomMission(Object.values(cities)[0], STORY, this.shelf), this.shelf);
    this.history = [data.tool ? CHANGES.tool(first, { tool: data.tool }) : first];
    this.hangar = new Hangar(this.stage.mission, this.agents, this.places);
  }

  /** The names of who can fly over a city: the agents made for it first, unless the reader gave one. */
  known = (city) => {
    const knowing = Object.entries(this.agents).filter(([, agent]) => agent.knows(city));
    const last = ([, { of, given }]) => (given ? 0 : of ? 1 : 2);
    knowing.sort((one, other) => last(one) - last(other));
    return [...knowing.map(([name]) => name), "greedy", "random"];
  };

  get stage() {
    return this.history[this.at];
  }

  set stage(stage) {
    this.history = this.history.map((each, k) => (k === this.at ? stage : each));
  }

  /** The names of all cities: those that were painted or opened, and those of the shelf. */
  get cities() {
    const shelf = Object.keys(this.shelf.cities);
    const own = this.history
      .map(({ mission }) => mission.city.name)
      .filter((name) => !shelf.includes(name));
    return [...new Set([...own, ...shelf])];
  }

  /** The name of a city that is painted: its own, unless the shelf has it, else the next that no other has. */
  paintedName(name) {
    if (name && !Object.hasOwn(this.shelf.cities, name)) return name;
    const taken = this.history.slice(0, this.at + 1).map(({ mission }) => mission.city.name);
    return ["my_city", ...taken.map((_, k) => `my_city_${k + 2}`)].find(
      (each) => !taken.includes(each),
    );
  }

  /** A stage of the history, looked at as one looks now. */
  again(stage) {
    const { tool, looks } = this.stage;
    return { ...stage, tool, looks, point: null };
  }

  /** Does what the page tells, or says why it was not done. */
  async hear(told) {
    if (!GO_ON.includes(told.kind)) [this.work, this.ended] = [null, !INSTEAD.includes(told.kind)];
    let refused = "";
    try {
      this.requireFits(told);
      if (this.does[told.kind]) await this.does[told.kind].call(this, told);
      else this.take(CHANGES[told.kind](this.stage, told, this.shelf), told.kind);
    } catch (error) {
      refused = reasonOf(error);
    }
    try {
      this.render(told, refused);
    } catch (error) {
      Object.assign(this, this.drawn); // what cannot be drawn is not kept
      this.render(told, reasonOf(error));
    }
  }

  /** The error names what is wrong with a message. */
  requireFits(told) {
    require(Object.hasOwn(MESSAGES, told.kind), `${told.kind}: nothing that can be done here`);
    for (const [entry, fits] of Object.entries(MESSAGES[told.kind]))
      require(fits(
        told[entry],
        this,
        told,
      ), `${told.kind}: ${entry} ${JSON.stringify(told[entry])} does not fit here`);
  }

  /** Shows what the stage looks like now, in answer to what was told. */
  render({ kind, quiet, number } = {}, refused = "") {
    const { stage, hangar, extra, history, at } = this;
    const flights = this.flights();
    const film = filmOf(hangar, flights, this.data.colours);
    const text = JSON.stringify(film);
    if (text !== this.filmed) [this.filmed, this.version] = [text, (this.version ?? 0) + 1];
    const scene = {
      tools: this.tools,
      state: this.summary(),
      stage: stageAsJson(stage),
      past: this.newPast(),
      film,
      version: this.version,
      panel: { ...this.panel(flights), ...this.extra },
      ...(stage.tool === "watch"
        ? { warnings: [] }
        : {
            // it is about the village
            place: hangar.place && sentence({ kind: "place", ...hangar.place }),
            warnings: warnings(hangar.environment, stage.mission).map(sentence),
          }),
      refused: refused && `Not ${kind === "move" ? "moved" : "done"}: ${refused}.`,
      note: this.notes.splice(0).map(sentence).join(" "),
      number,
      quiet: quiet || BESIDE.includes(kind), // no action of the reader
      fresh: !this.data.mission && !this.data.tool,
      working: Boolean(this.work),
    };
    this.drawn = { hangar, extra, history, at };
    this.post({ kind: "scene", scene });
  }

  /** All beside the stage that a reload takes up again, the stages before and after it, if that is no longer what the page was told. */
  newPast() {
    const { at, ranking, history, past } = this;
    const others = history.filter((_, k) => k !== at);
    const now = [at, ranking, ...others];
    if (now.length === past.length && now.every((each, k) => each === past[k])) return undefined;
    this.past = now;
    return { at, ranking, others: others.map(stageAsJson) };
  }

  summary() {
    const { mission, ...look } = this.stage;
    const names = [...this.known(mission.city), ...(look.flown ? [YOU] : [])];
    const known = names.map((name) => whoIs(name, this.agents));
    const agents = Object.values(this.agents).filter(
      ({ title }) => title && known.every((each) => each.title !== title),
    );
    const absent = [...new Set(agents.map(({ subject }) => subject))];
    return {
      ...look,
      city: mission.city.name,
      cities: this.cities,
      start: mission.start,
      devices: mission.devices.map((cell, k) => ({ cell, data: mission.data[k] })),
      most: mission.maxDevices,
      flyingTime: mission.flyingTime,
      known: known.map(({ name, title }) => [name, title]),
      absent: absent.length ? sentence({ kind: "absent", absent }) : "",
      undo: Boolean(this.history[this.next(-1)]),
      redo: Boolean(this.history[this.next(1)]),
    };
  }

  /** The two that fly any mission. */
  get pair() {
    const { policies } = this.stage;
    require(!policies.includes(
      YOU,
    ), "choose two agents, because your flight belongs to this mission");
    return policies;
  }

  get ghost() {
    return this.stage.policies[1] === YOU ? "greedy" : this.stage.policies[1];
  }

  /** The agent that thinks: the first that flies, or one that knows the city, or null. */
  get thinker() {
    const { policies, mission } = this.stage;
    return [...policies, ...this.known(mission.city)].find((name) => this.agents[name]) ?? null;
  }

  /** The flights that are drawn, with their titles; the ghost is the second one. */
  flights() {
    const { stage, hangar, shelf } = this;
    const { tool, policies, flown, looks, point } = stage;
    if (tool === "watch" && point) {
      const { steps, base64 } = pointOf(looks, point, shelf);
      this.agents[base64] ??= shelved({ base64 }, null); // without a size, it knows no city
      return [[`${RUNS[point[0]]}'s agent after ${grouped(steps)} steps`, hangar.flight(base64)]];
    }
    const names = {
      fly: [YOU, this.ghost],
      compare: policies,
      think: [this.thinker ?? policies[0]],
    }[tool] ?? [policies[0]];
    return names.map((name) => [whoIs(name, this.agents).title, hangar.flight(name, flown)]);
  }

  /** What the tool shows next to the map. */
  panel(flights) {
    return (
      this.panels[this.stage.tool]?.call(
        this,
        flights.map(([, flight]) => flight),
      ) ?? {}
    );
  }

  panels = {
    fly(flights) {
      const [you, ghost] = flights.map(numbers);
      const rival = whoIs(this.ghost, this.agents);
      const end = you.ended
        ? sentence({
            kind: "end",
            verdict: verdict([whoIs(YOU, this.agents), rival], [you, ghost]),
          })
        : "";
      return { you, ghost, rival, end, ranking: this.ranking.slice(0, RANKED) };
    },
    compare(flights) {
      const who = this.stage.policies.map((name) => whoIs(name, this.agents));
      const results = flights.map(numbers);
      const { environment } = this.hangar;
      const part = parting(...flights, environment.size);
      const facts = reasons(who, flights, part, environment);
      const look = [part ?? undefined, ...facts.map((fact) => fact.look)].filter(
        (step) => step !== undefined,
      );
      return {
        parting: part,
        look: [...new Set(look)].sort((one, other) => one - other),
        rule: sentence(RULE),
        verdict: sentence(verdict(who, results)),
        why: facts.map(sentence),
        results: results.map((each, k) => ({ ...each, who: who[k] })),
      };
    },
    think([flight]) {
      const { policies, mission } = this.stage;
      const name = this.thinker;
      if (!name) return { agent: null };
      const agents = this.known(mission.city).filter((each) => this.agents[each]);
      const says = choices(flight, this.hangar);
      return {
        name,
        agent: whoIs(name, this.agents).title,
        instead: name === policies[0] ? null : whoIs(policies[0], this.agents),
        agents: agents.map((each) => [each, whoIs(each, this.agents).title]),
        number: this.agents[name].scores ? "score" : "Q-value",
        actions: ACTIONS,
        values: flight.values.map((each) => Array.from(each)),
        closest: closestCall(flight),
        says: says.map(sentence),
        missed: missed(flight, says, this.hangar).map((fact) => (fact ? sentence(fact) : "")),
      };
    },
    channel() {
      const { mission, device } = this.stage;
      return { device, ...ledger(this.hangar.environment, mission.devices[device]) };
    },
    watch() {
      const {
        stage: { looks, point, mission },
        shelf: { races, village },
        data: {
          races: { episodes },
        },
      } = this;
      const before = this.history[this.next(-1)]?.mission.city ?? village;
      const runs = looks.runs.map((k) => races[k]);
      const bare = ({ points, ...run }) => ({
        ...run,
        kink: kinkOf({ points }),
        points: points.map(({ base64, ...each }) => each),
      });
      return {
        settings: races.map(({ title, text }) => [title, text]),
        mean: point && sentence(pointFact(pointOf(looks, point, this.shelf), episodes)),
        left: point && !village.sameAs(before),
        village: village.name,
        elsewhere: !village.sameAs(mission.city),
        runs: runs.map(bare),
        says: raceFacts(runs, episodes, looks.metric).map((fact) => ({
          text: sentence(fact),
          run: fact.run,
          at: fact.at ?? [],
        })),
      };
    },
  };

  /** Goes on with another stage; a change of its mission can be undone, and a move of the flight. */
  take(stage, kind) {
    const { mission, flown, policies } = this.stage;
    const { flyingTime, city } = stage.mission;
    require(city.name.length <= NAME, `city.name: at most ${NAME} letters fit here`);
    require(flyingTime <=
      LONGEST, `flying time ${flyingTime}: this page allows at most ${LONGEST} units of time`);
    if (stage.mission !== mission || stage.flown !== flown) {
      const soon =
        ["move", "data", "time"].includes(kind) && performance.now() - this.last[1] < TOGETHER;
      const at = this.at + (this.last[0] === kind && (soon || kind.startsWith("drag")) ? 0 : 1);
      const before = kind === "fly" ? [] : [...stage.flown]; // the moves of a flight that comes whole
      const moves = before.map((_, k) => ({ ...stage, flown: stage.flown.slice(0, k) }));
      this.history = [...this.history.slice(0, at), ...moves, stage].slice(-KEPT);
      this.at = this.history.length - 1;
      this.last = [kind, performance.now()];
      const left = this.history[this.at - 1]?.flown; // which a drag has ended, too
      if (left && !ELSEWHERE.includes(kind) && stage.mission !== mission)
        this.notes.push({ kind: "grounded", moves: left.length });
    } else this.stage = stage;
    if (stage.mission !== mission) this.settle();
    else if (String(stage.policies) !== String(policies)) this.extra = {};
  }

  /** Where undo (−1) or redo (1) leads in the history: in Fly to the next move, elsewhere past all of a flight. */
  next(by) {
    const { history, stage } = this;
    let at = this.at + by;
    if (stage.tool === "fly") return at;
    while (history[at]?.mission === stage.mission) at += by;
    while (by > 0 && history[at + 1]?.mission === history[at]?.mission && history[at]) at += 1;
    return at;
  }

  /** What belongs to a mission begins anew with another. */
  settle() {
    this.extra = {};
    this.hangar = new Hangar(this.stage.mission, this.agents, this.places, this.hangar);
  }

  /**
   * Runs what takes long, and returns what it finds. Others have their turn meanwhile, and most of what they
   * do ends it: what was asked for earlier never replaces what was done later.
   */
  async long(text, run) {
    const mine = (this.work = {});
    const requireWanted = () => {
      if (this.work !== mine)
        throw text && this.ended
          ? new InputError(`${text} was ended by what was done meanwhile`)
          : STOPPED;
    };
    let before = performance.now();
    const turn = async (share) => {
      if (performance.now() - before > TURN) {
        this.post({ kind: "progress", text: upper(text), share });
        await new Promise((resolve) => setTimeout(resolve));
        before = performance.now();
      }
      requireWanted();
    };
    try {
      const found = await run(turn);
      requireWanted();
      return found;
    } finally {
      if (this.work === mine) this.work = null;
      this.post({ kind: "progress", text: "" });
    }
  }

  /** What is done that is no change of the stage alone. */
  does = {
    cancel() {},
    /** A city is found as it was left. */
    city({ name }) {
      const city = this.shelf.cities[name];
      const left = this.history.findLast(
        ({ mission }) => mission.city.name === name && (!city || city.sameAs(mission.city)),
      );
      this.take(left ? this.again(left) : overCity(this.stage, city, this.shelf), "city");
    },
    undo({ by }) {
      const at = this.next(by);
      const there = this.history[at];
      require(there, `there is nothing more to ${by < 0 ? "undo" : "redo"}`);
      const same = there.mission === this.stage.mission;
      const stage = same ? { ...this.stage, flown: there.flown } : this.again(there);
      [this.at, this.last] = [at, ["undo", 0]];
      this.stage = stage;
      if (!same) this.settle();
    },
    /** A drag is one change; if it ends where nothing may stand, there was none. */
    move(told) {
      const kind = told.drag ? `drag ${told.drag}` : "move";
      try {
        this.take(CHANGES.move(this.stage, told, this.shelf), kind);
      } catch (error) {
        if (kind !== "move" && !told.ends) return; // it goes on
        if (this.last[0] === kind && kind !== "move") {
          this.does.undo.call(this, { by: -1 });
          this.history = this.history.slice(0, this.at + 1);
        }
        throw error;
      }
    },
    fly(told) {
      const { stage, hangar } = this;
      if (numbers(hangar.flight(YOU, stage.flown)).ended)
        throw new InputError("this flight is over: press Again");
      this.take(CHANGES.fly(stage, told), "fly");
      const you = numbers(hangar.flight(YOU, this.stage.flown));
      if (!you.ended) return;
      const ghost = numbers(hangar.flight(this.ghost));
      const { city, flyingTime } = stage.mission;
      const rank = {
        city: city.name,
        time: flyingTime,
        ...you,
        ahead: lead([you, ghost]),
        ghost: whoIs(this.ghost, this.agents).title,
      };
      this.ranking = [...this.ranking, rank].sort((one, other) => other.ahead - one.ahead);
    },
    /** The next mission in which the first policy wins (1), loses (−1), or is level (0); a search that found none goes on. */
    async duel({ wanted }) {
      const { stage, hangar, pair } = this;
      const { city, seed } = stage.mission;
      const about = String([city.rows, seed, pair, wanted]);
      const from = this.tried?.about === about ? this.tried.to : seed;
      const found = await this.long("the search for a duel", async (turn) => {
        for (let k = 1; k <= TRIES; k += 1) {
          const mission = randomMission(city, from + k, this.shelf);
          const flights = pair.map((name) => hangar.fly(mission, name));
          if (isDuel(wanted, flights.map(numbers), parting(...flights, city.size))) return mission;
          await turn(k / TRIES);
        }
        this.tried = { about, to: from + TRIES };
        const who = wanted && whoIs(pair[wanted > 0 ? 0 : 1], this.agents);
        throw new InputError(sentence({ kind: "none", who, missions: TRIES }));
      });
      this.take({ ...withMission(this.stage, found, this.shelf), policies: pair }, "duel");
    },
    /** The means of both policies over a hundred random missions, with their intervals. */
    async many({ quiet }) {
      const {
        stage: {
          mission: { city },
        },
        hangar,
        pair,
      } = this;
      const rows = pair.map(() => []);
      await this.long(quiet ? "" : `the flight of ${MISSIONS} missions`, async (turn) => {
        for (let k = 0; k < MISSIONS; k += 1) {
          const mission = randomMission(city, FIRST + k, this.shelf);
          for (const [which, name] of pair.entries()) {
            rows[which].push(numbers(hangar.fly(mission, name)));
            await turn((k + which / 2) / MISSIONS);
          }
        }
      });
      const percent = (interval) => interval.map((share) => Math.round(100 * share));
      const many = rows.map((flown, which) => {
        return {
          who: whoIs(pair[which], this.agents),
          both: percent(bootstrapInterval(flown.map((each) => Number(each.landed) * each.share))),
          landed: percent(wilsonInterval(flown.map((each) => Number(each.landed)))),
          time: percent(bootstrapInterval(flown.map((each) => each.timeUsed)))[0],
        };
      });
      this.extra = { ...this.extra, many };
    },
    /** The best value if the UAV were over each cell at a step. */
    values({ step }) {
      const { hangar, thinker } = this;
      if (!thinker) return;
      const { states, action } = hangar.flight(thinker);
      const at = Math.min(step, action.length - 1);
      const map = valueMap(hangar.pilot(thinker), states[at]);
      this.extra = {
        ...this.extra,
        map: { step: at, values: Array.from(map, (each) => (Number.isFinite(each) ? each : null)) },
      };
    },
    shadow({ cell }) {
      this.extra = {
        ...this.extra,
        shadow: { cell, rows: hiddenRows(this.hangar.environment, cell) },
      };
    },
    /** Chooses the point of a race whose agent flies, over the city in which it learned. */
    race({ point }) {
      const { stage, shelf } = this;
      const there = shelf.village.sameAs(stage.mission.city)
        ? stage
        : withMission(stage, randomMission(shelf.village, RACED, shelf), shelf);
      this.take({ ...there, point }, "race");
    },
    paint(told) {
      const places = ({ mission }) => [...mission.devices, mission.start];
      const before = places(this.stage);
      const name = this.paintedName(this.stage.mission.city.name);
      this.take(CHANGES.paint(this.stage, { ...told, name }, this.shelf), "paint");
      const moves = places(this.stage).map((cell, thing) => ({
        thing: thing < before.length - 1 ? `device ${thing}` : "the start",
        cell,
      }));
      const moved = moves.filter(({ cell }, k) => String(cell) !== String(before[k]));
      if (moved.length) this.notes.push({ kind: "moved", moved });
    },
    async open({ file, link, here, past, others }) {
      const notes = [];
      const stage = await this.long("", () => this.opened(file, link, notes));
      const { mission } = this.stage;
      const known = JSON.stringify(mission.asJson()) === JSON.stringify(stage.mission.asJson());
      const begins = here && this.history.length === 1;
      const flown = here && file && known && !begins ? this.stage.flown : stage.flown; // Back leaves a flight of the same mission as it is
      this.filmed = null; // so that its step is shown, though the flights may be the same
      this.take(known ? { ...stage, mission, flown } : stage, "open");
      if (begins && past) this.recall(past);
      else if (begins && this.at > 0)
        [this.history, this.at] = [this.history.slice(1), this.at - 1]; // there is nothing before
      const who = stage.policies.map((name) => whoIs(name, this.agents));
      this.notes.push(...notes.map((each) => ({ ...each, who, city: stage.mission.city.name })));
      if (file?.name && (others || !notes.length))
        this.notes.push({ kind: others ? "others" : "opened", file: file.name });
    },
    async save({ what }) {
      const { stage } = this;
      const { mission } = stage;
      if (what === "png") {
        this.post({
          kind: "file",
          name: `${mission.city.name}.png`,
          blob: await pictureOf(mission.city),
        });
        return;
      }
      this.notes.push({ kind: "saved", file: `${mission.city.name}_${what}.json` });
      const values = what === "mission" ? mission.asJson() : stageAsJson(stage);
      const blob = new Blob([JSON.stringify(values, null, 1)], { type: "application/json" });
      this.post({ kind: "file", name: `${mission.city.name}_${what}.json`, blob });
    },
  };

  /** Takes up what could be undone when the page was left. */
  recall({ at, others, ranking }) {
    const text = (mission) => JSON.stringify(mission);
    const missions = new Map([[text(this.stage.mission.asJson()), this.stage.mission]]); // moves of a flight have the same one
    const stages = others.map((each) => {
      const stage = readFile(text(each), this.shelf);
      return { ...stage, mission: kept(missions, text(each.mission), () => stage.mission) };
    });
    Object.assign(this, {
      history: [...stages.slice(0, at), this.stage, ...stages.slice(at)],
      at,
      ranking,
    });
  }

  /** The stage of a file or a link: a stage, a mission, a city's picture, or an agent. */
  async opened(file, link, notes) {
    if (link) return readFile(await textOfLink(link), this.shelf, notes);
    if (file.size > 40_000_000) throw new InputError("this file is too large");
    if (/\.png$/i.test(file.name)) {
      const city = await cityOfPicture(file, this.paintedName());
      return overCity(this.stage, city, this.shelf);
    }
    if (!/\.safetensors$/i.test(file.name)) return readFile(await file.text(), this.shelf, notes);
    const name = file.name.replace(/\.safetensors$/i, "");
    const agent = readAgent(new Uint8Array(await file.arrayBuffer()));
    this.agents[name] = givenAgent(name, agent);
    const knows = this.agents[name].knows(this.stage.mission.city);
    if (!knows && !agent.city)
      throw new InputError(`this agent flies over cities of at most ${agent.size} cells on a side`);
    const there = knows ? this.stage : overCity(this.stage, agent.city, this.shelf);
    return CHANGES.policy(
      { ...there, tool: there.tool === "watch" ? "compare" : there.tool },
      { which: 0, name },
      this.shelf,
    );
  }
}
