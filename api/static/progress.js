// Follows an analysis and shows its report, or why there is none, as soon as it has ended.
"use strict";

const analysis = document.getElementById("analysis");
const bar = document.getElementById("analysis-progress");
const stage = document.getElementById("stage");
const elapsed = document.getElementById("elapsed");

// A screen reader announces what changes here, so it changes only with the stage.
function say(text) {
  if (stage.textContent !== text) stage.textContent = text;
}

function describe(answer) {
  if (answer.state === "queued") return "Waiting for its turn";
  return answer.stage ? answer.stage[0].toUpperCase() + answer.stage.slice(1) : "Starting";
}

function duration(milliseconds) {
  const seconds = Math.max(0, Math.round(milliseconds / 1000));
  return seconds < 60 ? `${seconds} s` : `${Math.floor(seconds / 60)} min ${seconds % 60} s`;
}

async function follow() {
  let wait = 500;
  try {
    const response = await fetch(analysis.dataset.address);
    if (!response.ok) return location.reload();
    const answer = await response.json();
    if (answer.state === "done" || answer.state === "failed") return location.reload();
    bar.value = answer.progress;
    say(describe(answer));
    if (answer.started) {
      // Both times by the service's clock; the visitor's may be wrong.
      const now = new Date(response.headers.get("Date"));
      elapsed.textContent = `${duration(now - new Date(answer.started))} so far`;
    }
  } catch {
    say("The service does not answer; trying again");
    wait = 3000;
  }
  setTimeout(follow, wait);
}

follow();
