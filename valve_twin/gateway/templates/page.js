// SPDX-License-Identifier: Apache-2.0
// Copyright 2026 valve_twin maintainers
// Glue: times in the viewer's zone, what is stored asked anew, the moving plot put together. The server words and draws all.
"use strict";

const FORMAT = { dateStyle: "medium", timeStyle: document.querySelector("[data-clock]")?.dataset.clock ?? "medium" };
const local = (date) => date.toLocaleString(document.documentElement.lang, FORMAT);
const zone = (part) => part.querySelectorAll("time[datetime]").forEach((t) => {
  t.title = t.textContent;
  t.textContent = local(new Date(t.dateTime));
});
zone(document);

const parts = (page) => [...page.querySelectorAll(".stored")];
const [stored] = parts(document);
async function renew() {
  let lost = true;
  try {
    const answer = await fetch(location.href, { headers: { "X-Valve-Twin-Mark": stored.dataset.mark } });
    lost = false;
    if (answer.status === 204) return;
    const fresh = parts(new DOMParser().parseFromString(await answer.text(), "text/html"));
    if (!answer.ok || !fresh.length || document.querySelector(".stored form :focus")) return;
    const held = document.activeElement?.getAttribute("href");
    parts(document).forEach((part, at) => {
      part.replaceChildren(...(fresh[at]?.childNodes ?? []));
      zone(part);
    });
    Object.assign(stored.dataset, fresh[0].dataset);
    if (held) [...document.querySelectorAll("a")].find((a) => a.getAttribute("href") === held)?.focus();
  } catch { /* the server is gone: it says so below */ } finally {
    const gone = document.getElementById("gone");
    if (gone) gone.hidden = !lost;
  }
}
const again = async () => {
  await renew();
  setTimeout(again, 1000 * stored.dataset.reload);
};
if (stored) setTimeout(again, 1000 * stored.dataset.reload);

const live = document.getElementById("live");
if (live) {
  const WIDTH = 1000, QUIET_MS = 2000;
  const axes = document.getElementById("axes"), slices = document.getElementById("slices");
  let heard = Date.now(), asked, source, news;
  const make = (parent, kind, given) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", kind);
    for (const name in given) made.setAttribute(name, given[name]);
    return parent.appendChild(made);
  };
  const [, point] = (0.5).toLocaleString(document.documentElement.lang);
  const number = (text) => String(text).replace(".", point);
  const write = (name, text) => { const at = live.querySelector(`[data-value="${name}"]`); if (at) at.textContent = text; };
  const show = (told) => {
    heard = Date.now();
    live.dataset.state = told.state;
    if (told.news !== news && news !== undefined) renew();
    news = told.news;
    write("quiet", told.quiet);
    for (const name in told.values) write(name, number(told.values[name]));
    if (told.stamp) write("stamp", local(new Date(told.stamp)));
    if (told.axes) {
      axes.replaceChildren();
      slices.replaceChildren();
      for (const line of told.axes) {
        make(axes, "path", { class: "grid", d: `M0 ${line.y}H${WIDTH}` });
        make(axes, "text", { class: "tick end", x: -8, y: line.y + 5 }).textContent = number(line.text);
      }
    }
    for (const slice of told.slices) {
      const group = make(slices, "g", {});
      group.begins = slice.t;
      for (const curve in slice.d) make(group, "path", { class: curve, d: slice.d[curve] });
    }
    for (const group of [...slices.children]) {
      if (group.begins < told.right - 1.2 * WIDTH) group.remove();
      else group.setAttribute("transform", `translate(${(group.begins - told.right + WIDTH).toFixed(2)} 0)`);
    }
  };
  const listen = () => {
    asked = Date.now();
    source = new EventSource(live.dataset.source);
    source.onmessage = (event) => show(JSON.parse(event.data));
  };
  listen();
  setInterval(() => {
    if (Date.now() - heard > QUIET_MS) {
      live.dataset.state = "stale";
      write("quiet", Math.round((Date.now() - heard) / 1000));
    }
    if (source.readyState === EventSource.CLOSED && Date.now() - asked > QUIET_MS) listen();
  }, 250);
}
