// Follows an analysis by server-sent events and shows its report, or why there is none, as soon as it has ended.
"use strict";

(function () {
  const analysis = document.getElementById("analysis");
  const bar = document.getElementById("analysis-progress");
  const stage = document.getElementById("stage");
  const elapsed = document.getElementById("elapsed");
  let began = Number(analysis.dataset.elapsed) > 0 ? performance.now() - 1000 * Number(analysis.dataset.elapsed) : null;

  let over = null;  // when it should be

  // A screen reader announces what changes here, so it changes only with the stage.
  function say(text) {
    if (stage.textContent !== text) stage.textContent = text;
  }

  function describe(answer) {
    if (answer.state === "queued") return "Waiting for its turn";
    return answer.stage ? answer.stage[0].toUpperCase() + answer.stage.slice(1) : "Starting";
  }

  function inWords(seconds) {
    return seconds < 60 ? `${seconds} s` : `${Math.floor(seconds / 60)} min ${seconds % 60} s`;
  }

  function tick() {
    if (began === null) return;
    const now = performance.now(), left = over === null ? 0 : Math.round((over - now) / 5000) * 5;
    elapsed.textContent = inWords(Math.round((now - began) / 1000)) + (left > 0 ? `, about ${inWords(left)} to go` : " so far");
  }

  const events = new EventSource(analysis.dataset.events);
  events.addEventListener("progress", ({ data }) => {
    const answer = JSON.parse(data);
    if (answer.started && began === null) began = performance.now();
    if (began !== null && answer.progress > Math.max(bar.value, 0.1)) {
      over = performance.now() + (performance.now() - began) * (1 / answer.progress - 1);
    }
    bar.value = answer.progress;
    say(describe(answer));
    document.getElementById("happened").textContent = answer.happened || "";
    tick();
  });
  events.addEventListener("end", () => {
    events.close();
    location.reload();
  });
  events.onerror = () => {
    // Closed for good: it was deleted, or the token is no longer valid. The page itself says which.
    if (events.readyState === EventSource.CLOSED) location.reload();
    else say("The service does not answer; trying again");
  };
  addEventListener("pagehide", () => events.close());
  setInterval(tick, 1000);
  tick();
})();
