// A run in a worker of its own: it learns until it is stopped, and tells what the page shows.

import { checkpoint, partsOf, readAgent } from "./checkpoint.js";
import { bytesOf } from "./pilots.js";
import { Trainer } from "./training.js";

const TURN = 100; // ms of learning after which it hears what was told meanwhile
const SHOWN = 500; // ms between agents that it shows

export class Run {
  /**
   * @param {object} told what `Trainer` needs
   * @param {(answer: object) => void} post takes what the page is told
   */
  constructor(told, post) {
    const trainer = new Trainer(told);
    Object.assign(this, { trainer, post, going: false, sent: 0, told: 0, rate: 0 });
    this.tell();
  }

  /** Does what the page tells: `go`, `stop`, `step`, `turn`, `take` and `save`. */
  hear({ kind, dials, base64 }) {
    const { trainer, going } = this;
    const goes = going || trainer.finished; // one that has ended goes on if it gets more steps
    if (kind === "turn") trainer.turn(dials);
    else if (kind === "take")
      this.post({ kind: "run", points: [], dials: trainer.take(readAgent(bytesOf(base64))) });
    else if (kind === "save") return this.post({ kind: "file", bytes: checkpoint(trainer) });
    else if (kind === "step" && !trainer.finished) trainer.step();
    this.going = (kind === "go" || (goes && kind === "turn")) && !trainer.finished;
    if (this.going && !going) this.learn();
    if (!this.going || kind === "turn") this.tell();
  }

  learn() {
    if (!this.going) return;
    const [begin, steps] = [performance.now(), this.trainer.steps];
    while (!this.trainer.finished && performance.now() - begin < TURN) this.trainer.step();
    this.going = !this.trainer.finished;
    if (this.trainer.updates)
      this.rate = (this.trainer.steps - steps) / (performance.now() - begin);
    if (!this.going || performance.now() - this.told > SHOWN) this.tell();
    setTimeout(() => this.learn());
  }

  /** How far it has come, the points of the curves since it told last, and the agent of now. */
  tell() {
    const { going, rate, trainer } = this;
    const { steps, updates, points } = trainer;
    this.post({
      kind: "run",
      going,
      rate,
      steps,
      updates,
      points: points.slice(this.sent),
      agent: partsOf(trainer),
    });
    [this.sent, this.told] = [points.length, performance.now()];
  }
}
