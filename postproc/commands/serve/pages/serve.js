// What the pages cannot do by themselves: progress, the height of a result, and a word on a file that is too large.
"use strict";

const running = document.querySelector("[data-state]");
if (running) {
  const bar = running.querySelector("progress"), step = document.getElementById("step");
  const look = async () => {
    const answer = await fetch(running.dataset.state);
    if (!answer.ok) return location.reload();
    const {over, share, step: text} = await answer.json();
    if (over) return location.replace(`${location.pathname}?ended#result`);
    if (step.textContent !== text) step.textContent = text;
    if (share === null) bar.removeAttribute("value"); else bar.value = share;
    setTimeout(look, 700);
  };
  setTimeout(look, 300);
}

const frame = document.querySelector("iframe.result");
if (frame) {
  window.addEventListener("message", event => {
    if (event.source === frame.contentWindow && Number.isFinite(event.data.height))
      frame.style.height = `${Math.min(Math.max(event.data.height, 200), 60000)}px`;
  });
}

for (const form of document.querySelectorAll("form[data-largest]")) form.addEventListener("change", () => {
  const inputs = [...form.querySelectorAll("input[type=file]")];
  const size = inputs.flatMap(input => [...input.files]).reduce((sum, file) => sum + file.size, 0);
  const large = size > Number(form.dataset.largest);
  inputs[0].setCustomValidity(large ? `These files are larger than ${form.dataset.largest / 1e6} MB.` : "");
  if (large) inputs[0].reportValidity();
});
