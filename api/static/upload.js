// Sends a chosen or dropped log, shows how the upload goes and leads to the page of its analysis.
"use strict";

const form = document.getElementById("upload");
const input = document.getElementById("file");
const drop = form.querySelector(".drop");
const transfer = document.getElementById("transfer");
const title = document.getElementById("transfer-title");
const bar = document.getElementById("transfer-progress");
const text = document.getElementById("transfer-text");
const cancel = document.getElementById("cancel");
const problem = document.getElementById("problem");
const limit = Number(form.dataset.limit);

document.body.classList.add("scripted");

function size(bytes) {
  const units = ["bytes", "kB", "MB", "GB"];
  const power = Math.min(Math.floor(Math.log10(Math.max(bytes, 1)) / 3), units.length - 1);
  return `${(bytes / 1000 ** power).toLocaleString("en", { maximumSignificantDigits: 3 })} ${units[power]}`;
}

function show(element) {
  for (const each of [form, transfer]) each.hidden = each !== element;
}

function fail(reason) {
  document.title = "Not analysed · rotorid";
  show(form);
  input.value = "";  // so that choosing the same file again counts as a change
  problem.hidden = false;
  problem.textContent = reason;
  input.focus();
}

function start(files) {
  problem.hidden = true;
  if (files.length > 1) return fail("These are several files. Drop one log at a time; for a whole folder use “rotorid analyze” on your own computer.");
  const file = files[0];
  if (!file) return fail("That was no file. Drop a log from a folder, or choose one.");
  if (file.size > limit) return fail(`${file.name} has ${size(file.size)}; this service takes logs of up to ${form.dataset.limitText}.`);
  if (file.size === 0) return fail(`${file.name} is empty: the autopilot may have lost power before it wrote anything, or the copy failed.`);
  send(file);
}

function send(file) {
  title.textContent = `Uploading ${file.name}`;
  document.title = `Uploading ${file.name} · rotorid`;
  text.textContent = size(file.size);
  bar.value = 0;
  show(transfer);
  cancel.focus();

  const body = new FormData();
  body.append("file", file);
  const request = new XMLHttpRequest();  // fetch() does not tell how far an upload is
  request.responseType = "json";
  request.upload.onprogress = (event) => {
    bar.value = event.loaded / event.total;
    text.textContent = event.loaded < event.total ? `${size(event.loaded)} of ${size(event.total)}` : "Checking what arrived";
  };
  request.onload = () => {
    if (request.status === 201) analyse(request.response.id);
    else fail(request.response?.detail ?? `The service answered with an error (${request.status}).`);
  };
  request.onerror = () => fail("The upload was broken off: the file could not be read, or the connection to the service was lost. Try again.");
  request.onabort = () => {
    document.title = "rotorid: models from flight logs";
    show(form);
    input.value = "";
    input.focus();
  };
  cancel.onclick = () => request.abort();
  request.open("POST", "/api/v1/logs");
  request.send(body);
}

async function analyse(log) {
  try {
    const response = await fetch("/api/v1/analyses", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ log }),
    });
    const answer = await response.json();
    if (response.ok) location.assign(answer.links.page);
    else fail(answer.detail);
  } catch {
    fail("The log has arrived, but then the connection to the service was lost. Try again.");
  }
}

input.addEventListener("change", () => { if (input.files.length) start(input.files); });
form.addEventListener("submit", (event) => { event.preventDefault(); start(input.files); });

// A log may be dropped anywhere on the page; without this the browser would open it.
let depth = 0;
const mark = (change) => { depth = Math.max(0, depth + change); drop.classList.toggle("over", depth > 0); };
addEventListener("dragenter", (event) => { event.preventDefault(); mark(1); });
addEventListener("dragleave", () => mark(-1));
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => {
  event.preventDefault();
  mark(-depth);
  if (!form.hidden) start(event.dataTransfer.files);
});

// The browser's Back button may bring this page up as it was left, in the middle of an upload.
addEventListener("pageshow", (event) => {
  if (!event.persisted) return;
  show(form);
  input.value = "";
});
