// Where the code begins: on the page it draws the stage; in a worker, where it begins once more, it
// does what the first thing that it is told says.

import { Run } from "./run.js";
import { Session } from "./session.js";
import { draw } from "./stage.js";
import { setChannel } from "./world.js";

const WORK = { session: Session, run: Run };

if (typeof document === "undefined") serve();
else show();

function serve() {
  let work = null;
  onmessage = ({ data: told }) => {
    if (work) return work.hear(told);
    setChannel(told.channel);
    work = new WORK[told.work](told, (answer) => postMessage(answer));
  };
}

function show() {
  const pieces = document.querySelectorAll('script[type="application/json"]');
  const data = JSON.parse(Array.from(pieces, (piece) => piece.textContent).join(""));
  setChannel(data.channel);
  const code = encodeURIComponent(document.getElementById("code").textContent);

  /** Begins a worker, whose answers `hear` takes. Where none may begin, its work is done here. */
  function begin(work, first, hear) {
    const worker = new Worker(`data:text/javascript;charset=utf-8,${code}`);
    let send = (told) => worker.postMessage(told);
    worker.onmessage = ({ data: answer }) => hear(answer);
    worker.onerror = (event) => {
      event.preventDefault();
      worker.terminate();
      const here = new WORK[work](first, hear);
      send = (told) => setTimeout(() => here.hear(told));
    };
    send({ ...first, work, channel: data.channel });
    return { send: (told) => send(told), end: () => worker.terminate() };
  }

  const model = { begin, recipe: data.recipe, trained: data.trained };
  model.own = location.protocol !== "about:"; // in a notebook, the page has no address of its own
  draw(document.getElementById("stage"), model);
  model.send = begin("session", data, (answer) => model.hear(answer)).send;
}
