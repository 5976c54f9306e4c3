// What all pages share: errors of htmx' requests in words, announcements, menus that close, links that copy.
"use strict";

(function () {
  document.documentElement.classList.add("scripted");
  const problem = document.getElementById("problem");
  const said = document.getElementById("said");

  // What says that the report is loading stands behind it, and would be read out for good. The page has loaded when the
  // report in it has; the report alone may have before this script is here.
  const loading = document.querySelector(".loading");
  if (loading) addEventListener("load", () => { loading.hidden = true; });

  // What a request of htmx failed of is withdrawn when one succeeds; what others put there stays.
  let ours = false;

  function complain(text) {
    if (problem.textContent !== text) problem.textContent = text;  // it is read out whenever it is set
    problem.hidden = false;
    ours = true;
  }

  function withdraw() {
    if (ours) problem.hidden = true;
    ours = false;
  }

  function detailOf(request) {
    try {
      return JSON.parse(request.responseText).detail;
    } catch {
      return `The service answered with an error (${request.status}).`;
    }
  }

  document.addEventListener("htmx:responseError", ({ detail }) => {
    if (detail.xhr.status === 401) location.assign(`/sign-in?next=${encodeURIComponent(location.pathname)}`);
    else complain(detailOf(detail.xhr));
  });
  document.addEventListener("htmx:sendError", () => complain("The service does not answer. Is it running, and are you online?"));
  document.addEventListener("htmx:afterOnLoad", ({ detail }) => { if (detail.xhr.status < 400) withdraw(); });

  document.addEventListener("htmx:afterRequest", ({ detail }) => {
    const form = detail.requestConfig.elt;
    if (!detail.successful || !form.dataset.said) return;
    said.textContent = form.dataset.said;
  });

  // A button that is gone after its work leaves the keyboard nowhere; the list or panel that it was in takes over.
  document.addEventListener("htmx:afterSettle", ({ detail }) => {
    const target = detail.elt;
    if (document.activeElement !== document.body || detail.requestConfig?.verb === "get") return;
    const next = target.querySelector("[autofocus], button, a") ?? document.getElementById("main");
    next.focus();
    if (next.matches("input[readonly]")) next.select();
  });

  document.addEventListener("click", async ({ target }) => {
    for (const menu of document.querySelectorAll("details[name=menu][open]")) {
      if (!menu.contains(target) || target.closest(".panel a")) menu.open = false;
    }
    if (!target.dataset?.copies) return;
    const field = document.getElementById(target.dataset.copies);
    field.select();
    try {
      await navigator.clipboard.writeText(field.value);
    } catch {
      document.execCommand("copy");  // where the service is not on https there is no other way
    }
    target.textContent = "Copied";
    said.textContent = "Copied.";
  });

  document.addEventListener("keydown", ({ key }) => {
    const menu = key === "Escape" && document.querySelector("details[name=menu][open]");
    if (!menu) return;
    menu.open = false;
    menu.querySelector("summary").focus();
  });

  // A click into the report is not seen here, but it takes the focus.
  addEventListener("blur", () => {
    if (document.activeElement?.tagName === "IFRAME") {
      for (const menu of document.querySelectorAll("details[name=menu][open]")) menu.open = false;
    }
  });
})();
