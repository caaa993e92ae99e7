// Where the code begins: on the page it draws the stage; in a worker, where it begins once more, it
// computes what the stage shows.

import { Session } from "./session.js";
import { draw } from "./stage.js";

if (typeof document === "undefined") serve();
else show();

/** Answers the page. The first thing that it tells is what the page holds. */
function serve() {
  let session = null;
  onmessage = ({ data: told }) => {
    if (session) return session.hear(told);
    session = new Session(told, (answer) => postMessage(answer));
    session.render();
  };
}

function show() {
  const pieces = document.querySelectorAll('script[type="application/json"]');
  const data = JSON.parse(Array.from(pieces, (piece) => piece.textContent).join(""));
  const code = encodeURIComponent(document.getElementById("code").textContent);
  const model = { own: location.protocol !== "about:" }; // in a notebook, the page has no address of its own
  const worker = new Worker(`data:text/javascript;charset=utf-8,${code}`);
  worker.onmessage = ({ data: answer }) => model.hear(answer);
  worker.onerror = (event) => {
    // Where a page may begin no worker, its session computes here
    event.preventDefault();
    worker.terminate();
    const session = new Session(data, (answer) => model.hear(answer));
    model.send = (told) => session.hear(told);
    session.render();
  };
  model.send = (told) => worker.postMessage(told);
  draw(document.getElementById("stage"), model);
  model.send(data);
}
