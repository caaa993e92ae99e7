// For a lecture hall: a button that lets a part of the page fill the screen, with large letters.
function fullScreenButton(whole) {
  const button = document.createElement("button");
  button.type = "button";
  button.title = "Full screen";
  button.setAttribute("aria-label", button.title);
  button.innerHTML = `<svg width="16" height="16" viewBox="0 0 16 16" aria-hidden="true">
    <path d="M1 6V1h5M10 1h5v5M15 10v5h-5M6 15H1v-5" fill="none" stroke="currentColor"
      stroke-width="2"/></svg>`;
  button.addEventListener("click", () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else whole().requestFullscreen();
  });
  return button;
}
