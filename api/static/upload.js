// Sends chosen or dropped logs one by one, each with its own progress, and leads to their analysis.
"use strict";

(function () {
  const form = document.getElementById("upload");
  const input = document.getElementById("file");
  const drop = form.querySelector(".drop");
  const section = document.getElementById("transfers");
  const heading = document.getElementById("transfers-title");
  const list = document.getElementById("files");
  const choice = document.getElementById("choice");
  const together = document.getElementById("together");
  const problem = document.getElementById("problem");
  const said = document.getElementById("said");
  const limit = Number(form.dataset.limit);

  /** @type {{file: File, state: "waiting"|"sending"|"kept"|"refused", log?: string}[]} */
  let transfers = [];
  let sending = null;

  function size(bytes) {
    const units = ["bytes", "kB", "MB", "GB"];
    const power = Math.min(Math.floor(Math.log10(Math.max(bytes, 1)) / 3), units.length - 1);
    return `${(bytes / 1000 ** power).toLocaleString("en", { maximumSignificantDigits: 3 })} ${units[power]}`;
  }

  function element(tag, properties) {
    return Object.assign(document.createElement(tag), properties);
  }

  function complain(text) {
    problem.textContent = text;
    problem.hidden = false;
    problem.scrollIntoView({ block: "nearest" });
  }

  function add(files) {
    problem.hidden = true;
    input.value = "";  // so that choosing the same file again counts as a change
    if (!files.length) return complain("That was no file. Drop logs from a folder, or choose them.");
    section.hidden = false;
    for (const file of files) {
      const transfer = {
        file,
        state: "waiting",
        row: element("li", {}),
        text: element("span", { className: "hint" }),
        bar: element("progress", { max: 1, value: 0 }),
        button: element("button", { type: "button", className: "plain" }),
      };
      transfer.bar.setAttribute("aria-label", `Upload of ${file.name}`);
      transfer.row.append(element("span", { className: "name", textContent: file.name }), transfer.text, transfer.bar, transfer.button);
      list.append(transfer.row);
      transfers.push(transfer);
      offer(transfer, "Cancel", () => remove(transfer));
      if (file.size > limit) refuse(transfer, `This file has ${size(file.size)}; the service takes logs of up to ${form.dataset.limitText}.`);
      else if (file.size === 0) refuse(transfer, "This file is empty: the autopilot may have lost power before it wrote anything, or the copy failed.");
      else transfer.text.textContent = size(file.size);
    }
    heading.focus();
    next();
  }

  function offer(transfer, text, action) {
    transfer.button.textContent = text;
    transfer.button.setAttribute("aria-label", `${text} ${transfer.file.name}`);
    transfer.button.onclick = action;
  }

  function remove(transfer) {
    transfers = transfers.filter((each) => each !== transfer);
    transfer.row.remove();
    if (transfer === sending) {
      sending = null;
      transfer.request?.abort();
    }
    said.textContent = `${transfer.file.name} removed.`;
    heading.focus();
    if (!transfers.length) {
      section.hidden = true;
      input.focus();
    }
    next();
  }

  function refuse(transfer, reason, again = false) {
    transfer.state = "refused";
    transfer.row.classList.add("refused");
    transfer.bar.hidden = true;
    transfer.text.textContent = reason;
    if (again) offer(transfer, "Try again", () => { revive(transfer); heading.focus(); next(); });
    else offer(transfer, "Remove", () => remove(transfer));
  }

  function revive(transfer) {
    transfer.state = "waiting";
    transfer.row.classList.remove("refused");
    transfer.bar.hidden = false;
    transfer.bar.value = 0;
    offer(transfer, "Cancel", () => remove(transfer));
  }

  function next() {
    if (sending) return;
    sending = transfers.find((each) => each.state === "waiting") ?? null;
    choice.hidden = true;
    if (sending) send(sending);
    else settle();
  }

  function send(transfer) {
    transfer.state = "sending";
    document.title = `Uploading ${transfer.file.name} · rotorid`;
    const body = new FormData();
    body.append("file", transfer.file);
    const request = new XMLHttpRequest();  // fetch() does not tell how far an upload is
    transfer.request = request;
    request.responseType = "json";
    request.upload.onprogress = ({ loaded, total }) => {
      transfer.bar.value = loaded / total;
      transfer.text.textContent = loaded < total ? `${size(loaded)} of ${size(total)}` : "Checking what arrived";
    };
    request.onload = () => {
      if (request.status === 401) return location.assign("/sign-in");
      if (request.status === 429) return wait(transfer, Number(request.getResponseHeader("Retry-After")) || 10);
      if (request.status === 201) keep(transfer, request.response.id);
      else refuse(transfer, request.response?.detail ?? `The service answered with an error (${request.status}).`);
      over(transfer);
    };
    request.onerror = () => {
      refuse(transfer, "The upload was broken off: the file could not be read, or the connection to the service was lost.", true);
      over(transfer);
    };
    request.open("POST", "/api/v1/logs");
    request.send(body);
  }

  // The service takes so many uploads in a minute; a folder full of logs may hold more.
  function wait(transfer, seconds) {
    transfer.text.textContent = `The service asks to wait ${seconds} s`;
    setTimeout(() => { if (transfer === sending) send(transfer); }, 1000 * seconds);
  }

  function keep(transfer, log) {
    transfer.state = "kept";
    transfer.log = log;
    transfer.bar.value = 1;
    transfer.text.textContent = `${size(transfer.file.size)}, uploaded`;
    offer(transfer, "Remove", () => remove(transfer));
  }

  function over(transfer) {
    if (transfer === sending) sending = null;
    next();
  }

  function kept() {
    return [...new Set(transfers.filter((each) => each.state === "kept").map((each) => each.log))];
  }

  // All that can be sent has been: a single log is analysed at once, of several somebody has to say how.
  function settle() {
    document.title = "rotorid: models from flight logs";
    const logs = kept(), refused = transfers.some((each) => each.state === "refused");
    if (!logs.length) {
      if (refused) said.textContent = "Nothing was uploaded.";
      return;
    }
    if (transfers.length === 1) return analyse([logs]);
    choice.hidden = false;
    together.hidden = logs.length < 2;
    said.textContent = `${logs.length} of ${transfers.length} uploaded. Choose how to analyse them.`;
  }

  // What was set before the upload; a field left empty has its default.
  function settings() {
    const filled = [...form.querySelectorAll(".options input")].filter((input) => input.value.trim());
    return Object.fromEntries(filled.map((input) => {
      const number = Number(input.value.trim().replace(",", "."));
      return [input.name, Number.isFinite(number) ? number : input.value.trim()];
    }));
  }

  async function order(logs) {
    const response = await fetch("/api/v1/analyses", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ logs, configuration: settings() }),
    });
    const answer = await response.json();
    if (!response.ok) throw new Error(answer.detail);
    return answer.links.page;
  }

  async function analyse(orders) {
    let page;
    try {
      for (const logs of orders) page = await order(logs);
    } catch (error) {
      choice.hidden = false;
      // A TypeError is what fetch() throws where there is no connection.
      return complain(error instanceof TypeError ? "The logs have arrived, but then the connection to the service was lost. Try again." : error.message);
    }
    location.assign(orders.length === 1 ? page : "/analyses");
  }

  document.getElementById("each").addEventListener("click", () => analyse(kept().map((log) => [log])));
  together.addEventListener("click", () => analyse([kept()]));
  input.addEventListener("change", () => { if (input.files.length) add([...input.files]); });
  form.addEventListener("submit", (event) => { event.preventDefault(); add([...input.files]); });

  // Logs may be dropped anywhere on the page; without this the browser would open them.
  let depth = 0;
  const mark = (change) => { depth = Math.max(0, depth + change); drop.classList.toggle("over", depth > 0); };
  addEventListener("dragenter", (event) => { event.preventDefault(); mark(1); });
  addEventListener("dragleave", () => mark(-1));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    mark(-depth);
    add([...event.dataTransfer.files]);
  });

  // The browser's Back button may bring this page up as it was left; what was uploaded is in the list of analyses.
  addEventListener("pageshow", ({ persisted }) => { if (persisted) location.reload(); });
})();
