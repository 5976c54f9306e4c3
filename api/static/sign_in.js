// Who comes from a link in another site's page has a cookie that the browser did not send along: go on with it.
"use strict";

fetch("/api/v1/logs?limit=1").then((response) => {
  if (response.ok) location.replace(document.querySelector("form[data-next]").dataset.next);
}).catch(() => {});
