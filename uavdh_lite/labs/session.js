// A session: it hears what is done on the page, and says what is to be drawn. It runs in a worker,
// so that no computation stops the drawing.

import { hiddenRows, ledger } from "./channel.js";
import { DAMAGED, digestOfParts, readAgent } from "./checkpoint.js";
import { cause, headline, isDuel, parting } from "./compare.js";
import { Hangar, filmOf, numbers, whoIs } from "./flights.js";
import { Agent, bytesOf, valueMap } from "./pilots.js";
import {
  CHANGES,
  TOOLS,
  YOU,
  cityOfPicture,
  flying,
  namedBy,
  newStage,
  overCity,
  pictureOf,
  randomMission,
  readFile,
  scenarioOf,
  stageAsJson,
  textOfLink,
  withMission,
} from "./state.js";
import { cameOf, changed, worths } from "./think.js";
import { City, InputError, require, studentInterval } from "./world.js";
import { LONGEST, upper } from "./words.js";

const KEPT = 100; // changes and moves that can be undone
const MISSIONS = 100;
const TRIES = 200; // missions that are looked at for a duel
const FIRST = 1_000_000; // of the missions that are drawn for means; "New" does not come so far
const STORY = 358; // the mission that the page begins with, chosen because it shows a difference
const TURN = 50; // ms of a computation after which others have their turn
const EMPTY = [8, 12, 16]; // cells on a side of cities that are still to be painted
const BESIDE = ["show", "values", "shadow", "look", "see", "why", "whatIf"]; // no action
const GO_ON = [...BESIDE, "tool", "save", "learned"]; // what does not end what takes long
const UNCHANGED = { away: [], moved: {}, time: 0 }; // what if nothing were different
const LEARNERS = ["your agent", "your second agent"]; // by their runs in Train
const TAKEN = [...LEARNERS, "greedy", "random", YOU]; // titles that no other agent gets
const STOPPED = new InputError("");

/** Why something was not done, for people; nothing if they ended it themselves. */
function reasonOf(error) {
  if (error instanceof InputError) return error.message.slice(0, 300);
  console.error(error);
  return `this did not work: ${error}`;
}

/**
 * An agent that is read from its bytes when it is first needed.
 * @param {City | null} of the city that it was made for; null if for all up to its size
 */
function shelved({ title, given, subject, size, scores, base64, read }, of) {
  subject ??= `the ${given ? "agent " : ""}${title}`;
  const knows = (city) => (of ? of.sameAs(city) : city.size <= size);
  return {
    ...{ title, subject, scores, given, of, knows },
    get agent() {
      return (read ??= readAgent(bytesOf(base64)));
    },
  };
}

export class Session {
  /**
   * @param {object} data what the page holds; see page.py
   * @param {(told: object) => void} post takes what the page is told
   */
  constructor(data, post) {
    Object.assign(this, { data, post, at: 0, last: "", extra: {}, notes: [] });
    this.drawn = FIRST + MISSIONS * Math.floor(1e6 * Math.random());
    const [cities, scenarios] = [{}, {}];
    for (const { name, rows, scenario } of data.cities) {
      cities[name] = City.fromText(name, rows.join("\n"));
      scenarios[name] = scenario;
    }
    for (const size of EMPTY) {
      const rows = Array.from({ length: size }, (_, r) => (r < 2 ? "LL" : "").padEnd(size, "."));
      const name = `empty ${size} × ${size}`;
      cities[name] ??= City.fromText(name, rows.join("\n"));
    }
    this.tools = data.tool ? [data.tool] : TOOLS;
    const [agents, { channel }] = [{}, data];
    Object.assign(this, { agents, history: [] });
    this.shelf = { cities, scenarios, agents, channel, known: this.known, tools: TOOLS };
    for (const each of data.agents) {
      const of = cities[each.city] ?? null;
      if (each.digest) this.addAgent(each, of);
      else this.agents[each.name] = shelved(each, of);
    }
    const first = data.mission
      ? this.named(readFile(JSON.stringify(data.mission), this.shelf))
      : newStage(randomMission(Object.values(cities)[0], STORY, this.shelf), this.shelf);
    this.history = [data.tool ? CHANGES.tool(first, { tool: data.tool }) : first];
    this.hangar = new Hangar(this.stage.mission, this.agents);
    this.render();
  }

  /** Who can fly over a city: the agents made for it first, unless the reader gave one. */
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
    const own = this.history.map(({ mission }) => mission.city.name);
    return [...new Set([...own.filter((name) => !shelf.includes(name)), ...shelf])];
  }

  /** A name, with a number if a city other than this one has it. */
  free(name, city = null) {
    const own = this.history.map(({ mission }) => mission.city);
    const all = [...own, ...Object.values(this.shelf.cities)];
    const taken = all.filter((each) => !city?.sameAs(each)).map((each) => each.name);
    return [name, ...taken.map((_, k) => `${name}_${k + 2}`)].find((each) => !taken.includes(each));
  }

  /** The name of a city that is painted: its own, or, where the shelf has it, a new one. */
  paintedName = (name) =>
    name && !Object.hasOwn(this.shelf.cities, name) ? name : this.free("my_city");

  /** The stage of a file, whose city has a name of its own. */
  named(stage) {
    const { city } = stage.mission;
    const name = this.free(city.name, city);
    if (name === city.name) return stage;
    return { ...stage, mission: stage.mission.with({ city: new City(name, city.kinds) }) };
  }

  /** A stage of the history, looked at as one looks now, with who can fly there now. */
  again(stage) {
    const { tool, looks } = this.stage;
    const policies = flying(stage.policies, stage.mission.city, this.shelf);
    return { ...stage, policies, tool, looks };
  }

  /** Does what the page tells, or says why it was not done. */
  async hear(told) {
    if (!GO_ON.includes(told.kind)) this.work = null;
    let refused = "";
    try {
      if (this.does[told.kind]) await this.does[told.kind].call(this, told);
      else this.take(CHANGES[told.kind](this.stage, told, this.shelf), told.kind);
    } catch (error) {
      refused = reasonOf(error);
    }
    this.render(told, refused);
  }

  /** Shows what the stage looks like now, in answer to what was told. */
  render({ kind, quiet, number } = {}, refused = "") {
    const { stage, hangar, extra } = this;
    const flights = this.flights();
    const { moved } = stage.tool === "think" ? this.whatIf : UNCHANGED;
    const film = filmOf(hangar, flights, this.data.colours, moved);
    const text = JSON.stringify(film);
    if (text !== this.filmed) [this.filmed, this.version] = [text, (this.version ?? 0) + 1];
    const flown = flights.map(([, flight]) => flight);
    const panel = this.panels[stage.tool]?.call(this, flown);
    const scene = {
      tools: this.tools,
      state: this.summary(),
      stage: stageAsJson(stage),
      film,
      version: this.version,
      panel: { ...panel, ...extra },
      refused: refused && `Not ${kind === "move" ? "moved" : "done"}: ${refused}.`,
      note: this.notes.splice(0).join(" "),
      number,
      quiet: quiet || BESIDE.includes(kind), // no action of the reader
      fresh: !this.data.mission && !this.data.tool,
      working: Boolean(this.work),
    };
    this.post({ kind: "scene", scene });
  }

  summary() {
    const { mission, ...look } = this.stage;
    const names = [...this.known(mission.city), ...(look.flown ? [YOU] : [])];
    const known = names.map((name) => whoIs(name, this.agents));
    return {
      ...look,
      city: mission.city.name,
      cities: this.cities,
      start: mission.start,
      devices: mission.devices.map((cell, k) => ({ cell, data: mission.data[k] })),
      most: mission.maxDevices,
      flyingTime: mission.flyingTime,
      known: known.map(({ name, title }) => [name, title]),
      undo: this.at > 0,
      redo: this.at < this.history.length - 1,
    };
  }

  /** The two that fly any mission. */
  get pair() {
    const { policies } = this.stage;
    const any = !policies.includes(YOU);
    require(any, "choose two agents, because your flight belongs to this mission");
    return policies;
  }

  get ghost() {
    return this.stage.policies[1] === YOU ? "greedy" : this.stage.policies[1];
  }

  /** The agent that thinks: the first that flies, or one that knows the city, or null. */
  get thinker() {
    const { policies, mission, tool } = this.stage;
    if (tool === "train") return this.learner;
    return [...policies, ...this.known(mission.city)].find((name) => this.agents[name]) ?? null;
  }

  /** The agent that learns, as it is now, if it learned in this city. */
  get learner() {
    const agent = this.agents[this.learns];
    return agent?.knows(this.stage.mission.city) ? this.learns : null;
  }

  /** What is tried in Think. */
  get whatIf() {
    return this.extra.whatIf ?? UNCHANGED;
  }

  /** Whose flights are drawn; the ghost is the second one. */
  get drawnOnes() {
    const { tool, policies } = this.stage;
    const names = {
      fly: [YOU, this.ghost],
      compare: policies,
      think: [this.thinker ?? policies[0]],
      train: [this.learner ?? policies[0]],
    };
    return names[tool] ?? [policies[0]];
  }

  /** The flights that are drawn, with their titles. */
  flights() {
    const flight = (name) => this.hangar.flight(name, this.stage.flown);
    return this.drawnOnes.map((name) => [whoIs(name, this.agents).title, flight(name)]);
  }

  /** What the tools show next to the map. */
  panels = {
    fly(flights) {
      const [you, ghost] = flights.map(numbers);
      const rival = whoIs(this.ghost, this.agents);
      const said = headline([whoIs(YOU, this.agents), rival], [you, ghost]);
      return { you, ghost, rival, headline: said };
    },
    compare(flights) {
      const { hangar, stage } = this;
      const who = stage.policies.map((name) => whoIs(name, this.agents));
      const results = flights.map(numbers);
      const part = parting(...flights);
      const flyOn = (which, actions) =>
        [YOU, "random"].includes(stage.policies[which])
          ? null // nobody knows how they would go on
          : numbers(hangar.fly(stage.mission, stage.policies[which], "", actions));
      const why = cause(who, flights, results, part, flyOn);
      return { who, parting: part, headline: headline(who, results), cause: why };
    },
    think([flight]) {
      const { hangar, whatIf, thinker: name } = this;
      const { mission } = this.stage;
      if (!name) return { agent: null };
      const { agent } = this.agents[name];
      const values = flight.values.map(finite);
      const states = flight.states.slice(0, -1);
      const asks = (state) => hangar.pilot(name).qValues(changed(state, whatIf, mission.city));
      const agents = this.known(mission.city).filter((each) => this.agents[each]);
      return {
        name,
        agent: whoIs(name, this.agents).title,
        agents: agents.map((each) => [each, whoIs(each, this.agents).title]),
        number: this.agents[name].scores ? "score" : "Q-value",
        values,
        whatIf,
        other: whatIf === UNCHANGED ? null : states.map((state) => finite(asks(state))),
        expected: flight.values.map((each) => Math.max(...each)),
        came: states.map((_, step) => cameOf(flight.reward, step, agent.recipe.discount)),
      };
    },
    channel() {
      const { mission, device } = this.stage;
      return { device, ...ledger(this.hangar.environment, mission.devices[device]) };
    },
    train([flight]) {
      const { city } = this.stage.mission;
      return {
        city: { name: city.name, rows: city.rows },
        scenario: scenarioOf(city, this.shelf),
        values: this.learner && flight.values.map(finite),
      };
    },
  };

  /** Goes on with another stage; changes of the mission and moves of the flight can be undone. */
  take(stage, kind) {
    const { mission, flown, policies } = this.stage;
    const { flyingTime: time } = stage.mission;
    require(time <= LONGEST, `flying time ${time}: this page allows at most ${LONGEST}`);
    if (stage.mission !== mission || stage.flown !== flown) {
      const same = this.last === kind && kind.startsWith("drag");
      const all = [...this.history.slice(0, this.at + (same ? 0 : 1)), stage];
      const names = all.map((each) => each.mission.city.name);
      const old = names.findIndex((name, k) => names.lastIndexOf(name) > k); // a city stays
      this.history = all.length > KEPT && old >= 0 ? all.toSpliced(old, 1) : all;
      this.at = this.history.length - 1;
      this.last = kind;
    } else this.stage = stage;
    if (stage.mission !== mission) this.settle();
    else if (String(stage.policies) !== String(policies)) this.extra = {};
  }

  /** What belongs to a mission begins anew with another. */
  settle() {
    this.extra = {};
    this.hangar = new Hangar(this.stage.mission, this.agents, this.hangar);
  }

  /**
   * Runs what takes long, and returns what it finds. Most of what is done meanwhile ends it, so
   * that what was asked for earlier never replaces what was done later.
   */
  async long(text, run) {
    const mine = (this.work = {});
    const requireWanted = () => {
      if (this.work !== mine) throw STOPPED;
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

  /** Adds an agent that somebody gave. @returns {string} its name, by which it is known */
  addAgent(told, of) {
    const name = namedBy(told.title, told.digest);
    const others = Object.keys(this.agents).filter((each) => each !== name);
    const taken = [...TAKEN, ...others.map((each) => this.agents[each].title)].includes(told.title);
    const title = taken ? `${told.title} ${told.digest.slice(0, 4)}` : told.title;
    this.agents[name] ??= shelved({ ...told, title, given: true }, of);
    return name;
  }

  /** What is done that is no change of the stage alone. */
  does = {
    cancel() {},
    /** A city is found as it was left. */
    city({ name }) {
      const city = this.shelf.cities[name];
      const left = this.history.findLast(({ mission }) => mission.city.name === name);
      this.take(left ? this.again(left) : overCity(this.stage, city, this.shelf), "city");
    },
    undo({ by }) {
      const there = this.history[this.at + by];
      require(there, `there is nothing more to ${by < 0 ? "undo" : "redo"}`);
      const same = there.mission === this.stage.mission;
      const stage = same ? { ...this.stage, flown: there.flown } : this.again(there);
      [this.at, this.last] = [this.at + by, "undo"];
      this.stage = stage;
      if (!same) this.settle();
    },
    /** A drag is one change; where nothing may stand, what is dragged stays where it was. */
    move(told) {
      try {
        const kind = told.drag ? `drag ${told.drag}` : "move";
        this.take(CHANGES.move(this.stage, told, this.shelf), kind);
      } catch (error) {
        if (!told.drag || told.ends) throw error;
      }
    },
    fly(told) {
      const { stage, hangar } = this;
      const { ended } = numbers(hangar.flight(YOU, stage.flown));
      require(!ended, "this flight is over; press Again");
      this.take(CHANGES.fly(stage, told), "fly");
    },
    /** The next mission in which the first policy wins (1) or loses (−1). */
    async duel({ wanted }) {
      const { stage, hangar, pair } = this;
      const { city, seed } = stage.mission;
      this.looked = Math.max(this.looked ?? 0, seed);
      const found = await this.long("the search", async (turn) => {
        for (let k = 1; k <= TRIES; k += 1) {
          const mission = randomMission(city, (this.looked += 1), this.shelf);
          const results = pair.map((name) => numbers(hangar.fly(mission, name)));
          if (isDuel(wanted, results)) return mission;
          await turn(k / TRIES);
        }
        const { subject } = whoIs(pair[wanted > 0 ? 0 : 1], this.agents);
        const found = `ahead in none of the next ${TRIES} missions: press again to go on`;
        throw new InputError(`${subject} is ${found}`);
      });
      this.take(withMission(this.stage, found, this.shelf), "duel");
    },
    /** The means of both policies over a hundred new missions, with their intervals. */
    async many() {
      const { hangar, pair } = this;
      const { city } = this.stage.mission;
      const who = pair.map((name) => whoIs(name, this.agents));
      const from = this.drawn;
      this.drawn += MISSIONS;
      const rows = pair.map(() => []);
      await this.long(`the flight of ${MISSIONS} missions`, async (turn) => {
        for (let k = 0; k < MISSIONS; k += 1) {
          const mission = randomMission(city, from + k, this.shelf);
          for (const [which, name] of pair.entries()) {
            const { landed, share } = numbers(hangar.fly(mission, name));
            rows[which].push(landed ? 100 * share : 0);
            await turn((k + which / 2) / MISSIONS);
          }
        }
      });
      const many = {
        rows: rows.map((row, k) => ({ who: who[k], both: studentInterval(row) })),
        difference: studentInterval(rows[0].map((each, k) => each - rows[1][k])),
        from,
      };
      this.extra = { ...this.extra, many };
    },
    /** The best value if the UAV were over each cell at a step. */
    values({ step }) {
      const { hangar, thinker } = this;
      if (!thinker) return;
      const { states, action } = hangar.flight(thinker);
      const at = Math.min(step, action.length - 1);
      this.extra = {
        ...this.extra,
        map: { step: at, ...valueMap(hangar.pilot(thinker), states[at]) },
      };
    },
    /** What each device is worth at a step, and what its absence changes. */
    why({ step }) {
      const { hangar, thinker } = this;
      if (!thinker) return;
      const { states, action } = hangar.flight(thinker);
      const at = Math.min(step, action.length - 1);
      const why = {
        step: at,
        ...worths(states[at], (state) => hangar.pilot(thinker).qValues(state)),
      };
      this.extra = { ...this.extra, why };
    },
    /** Tries a device away or elsewhere, or another time; `clear` ends it. A drag is as in `move`. */
    whatIf({ device, away, cell, by, time, clear, drag, ends }) {
      const { whatIf } = this;
      const { devices } = this.stage.mission;
      cell ??= by && (whatIf.moved[device] ?? devices[device]).map((axis, k) => axis + by[k]);
      const { [device]: _, ...others } = whatIf.moved;
      const gone = whatIf.away.filter((each) => each !== device);
      let next = whatIf;
      if (away !== undefined)
        next = { ...whatIf, away: away ? [...gone, device] : gone, moved: others };
      if (cell) {
        try {
          this.stage.mission.with({ devices: devices.with(device, cell) });
        } catch (error) {
          if (drag && !ends) return;
          throw error;
        }
        next = { ...whatIf, away: gone, moved: { ...others, [device]: cell } };
      }
      if (time !== undefined) next = { ...next, time };
      const none = clear || (!next.away.length && !Object.keys(next.moved).length && !next.time);
      this.extra = { ...this.extra, whatIf: none ? UNCHANGED : next };
    },
    /** Takes the agents of the runs in Train as they are now; the chosen one is shown there. */
    learned({ which, agents, step }) {
      const before = String(this.drawnOnes);
      for (const [k, parts] of agents.filter(([, agent]) => agent)) {
        const [title, read] = [LEARNERS[k], new Agent(parts.about, parts.tensors)];
        const name = namedBy(title, digestOfParts(parts));
        const mine = Object.entries(this.agents).filter(([, each]) => each.title === title);
        const [old] = mine.find(([, each]) => each.knows(read.city)) ?? []; // as it was
        delete this.agents[old];
        if (!this.work) this.hangar.forget(old);
        const told = { title, subject: title, given: true, size: read.size, read };
        this.agents[name] = shelved(told, read.city);
        const renamed = ({ policies }) => policies.map((each) => (each === old ? name : each));
        this.history = this.history.map((each) => ({ ...each, policies: renamed(each) }));
        if (k === which) this.learns = name;
      }
      if (String(this.drawnOnes) !== before) this.extra = {};
      if (this.learner && this.stage.tool === "train") this.does.values.call(this, { step });
    },
    shadow({ cell }) {
      const rows = hiddenRows(this.hangar.environment, cell);
      this.extra = { ...this.extra, shadow: { cell, rows } };
    },
    paint(told) {
      const name = this.paintedName(this.stage.mission.city.name);
      this.take(CHANGES.paint(this.stage, { ...told, name }, this.shelf), "paint");
    },
    async open({ file, link }) {
      const notes = [];
      const stage = this.named(await this.long("", () => this.opened(file, link, notes)));
      const { mission } = this.stage;
      const known = JSON.stringify(mission.asJson()) === JSON.stringify(stage.mission.asJson());
      this.filmed = null; // so that its step is shown, though the flights may be the same
      this.take(known ? { ...stage, mission } : stage, "open");
      this.notes.push(...notes, ...(file?.name && !notes.length ? [`${file.name} is open.`] : []));
    },
    async save({ what }) {
      const { stage } = this;
      const { mission } = stage;
      if (what === "png") {
        const content = await (await pictureOf(mission.city)).arrayBuffer();
        return this.post({ kind: "file", name: `${mission.city.name}.png`, content });
      }
      const name = `${mission.city.name}_${what}.json`;
      this.notes.push(`Saved as ${name}.`);
      const values = what === "mission" ? mission.asJson() : stageAsJson(stage);
      this.post({ kind: "file", name, content: JSON.stringify(values, null, 1) });
    },
  };

  /** The stage of a file or a link: a stage, a mission, a city's picture, or an agent. */
  async opened(file, link, notes) {
    if (link) return readFile(await textOfLink(link), this.shelf, notes);
    if (file.bytes.length > 40_000_000) throw new InputError("this file is too large");
    if (/\.png$/i.test(file.name)) {
      const city = await cityOfPicture(file, this.paintedName());
      return overCity(this.stage, city, this.shelf);
    }
    if (!/\.safetensors$/i.test(file.name))
      return readFile(new TextDecoder().decode(file.bytes), this.shelf, notes);
    const read = readAgent(file.bytes);
    const { digest, size, recipe, city } = read;
    require(digest, DAMAGED);
    const title = file.name.replace(/\.safetensors$/i, "");
    const scores = recipe.kind === "ImitationRecipe";
    const name = this.addAgent({ title, digest, size, scores, read }, city);
    const knows = this.agents[name].knows(this.stage.mission.city);
    require(knows || city, `this agent flies over cities of at most ${size} cells on a side`);
    const there = knows ? this.stage : overCity(this.stage, city, this.shelf);
    const tool = ["compare", "think"].includes(there.tool) ? there.tool : "compare";
    return CHANGES.policy({ ...there, tool }, { which: 0, name }, this.shelf);
  }
}

const finite = (values) => Array.from(values, (each) => (Number.isFinite(each) ? each : null));
