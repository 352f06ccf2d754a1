/* The search of the site, by the rules of automarine_cli/guide/search.py, which has written `searchIndex`. */
"use strict";
const { titles, sections, worths, synonyms, synonymShare, beginningShare, phraseFactor, rest, restShare } = searchIndex;
const escaped = text => text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
const bounded = key => new RegExp(`(?<![\\p{L}\\p{N}_])${escaped(key)}s?(?![\\p{L}\\p{N}_])`, "gu");
const stems = text =>
  (text.toLowerCase().match(/[\p{L}\p{N}_]+/gu) || []).map(word => word.replace(/(?<=[^s]{3})s$/, ""));

function alternatives(query) {
  const plain = query.toLowerCase().replaceAll("-", " ").split(/\s+/).filter(Boolean).join(" ");
  const known = Object.entries(synonyms).filter(([key]) => bounded(key).test(plain));
  return [plain, ...known.flatMap(([key, words]) => words.map(word => plain.replace(bounded(key), word)))];
}

function worthsOf(words) {
  const sums = new Map(), present = new Map(), wanted = stems(words);
  for (const word of wanted) {
    const best = new Map();
    for (const other in worths)
      if (other.startsWith(word))
        for (let i = 0; i < worths[other].length; i += 2) {
          const worth = worths[other][i + 1] * (other === word ? 1 : beginningShare);
          best.set(worths[other][i], Math.max(best.get(worths[other][i]) || 0, worth));
        }
    for (const [number, worth] of best) {
      sums.set(number, (sums.get(number) || 0) + worth);
      present.set(number, (present.get(number) || 0) + 1);
    }
  }
  for (const [number, sum] of sums) {
    const [, heading, text] = sections[number];
    const phrase = wanted.length > 1 && `${heading}\n${text}`.toLowerCase().replaceAll("-", " ").includes(words);
    sums.set(number, sum * (present.get(number) / wanted.length) ** 2 * (phrase ? phraseFactor : 1));
  }
  return sums;
}

function ranked(terms) {
  const best = new Map(), pages = new Map();
  terms.forEach((words, rank) => {
    for (const [number, worth] of worthsOf(words))
      best.set(number, Math.max(best.get(number) || 0, worth * (rank ? synonymShare : 1)));
  });
  for (const [number, worth] of best) {
    const page = sections[number][0];
    pages.set(page, [...(pages.get(page) || []), [worth, number]]);
  }
  const order = [...pages].map(([page, own]) => {
    const first = own.sort((a, b) => b[0] - a[0] || a[1] - b[1]).slice(0, rest);
    return [page, first[0][0] + restShare * first.slice(1).reduce((sum, [worth]) => sum + worth, 0), first[0][1]];
  });
  return order.sort((a, b) => b[1] - a[1] || (a[0] < b[0] ? -1 : 1)).map(([, , number]) => sections[number]);
}

function excerpt(text, terms, around = 90) {
  const words = [...new Set(terms.flatMap(stems))], lines = text.split("\n");
  const has = line => words.filter(word => line.toLowerCase().includes(word)).length;
  const whole = terms.flatMap(term => lines.filter(line => line.toLowerCase().replaceAll("-", " ").includes(term)))[0];
  const line = whole || lines.reduce((best, line) => (has(line) > has(best) ? line : best), lines[0]);
  const marks = new RegExp(words.map(escaped).join("|"), "gi"), at = Math.max(0, line.search(marks));
  const from = at > around ? line.indexOf(" ", at - around) + 1 : 0;
  const to = line.length > at + 2 * around ? line.lastIndexOf(" ", at + 2 * around) : line.length;
  const shown = line.slice(from, to), made = document.createElement("p");
  made.append(from ? "… " : "");
  let last = 0;
  for (const match of shown.matchAll(marks)) {
    const mark = document.createElement("mark");
    mark.textContent = match[0];
    made.append(shown.slice(last, match.index), mark);
    last = match.index + match[0].length;
  }
  made.append(shown.slice(last), to < line.length ? " …" : "");
  return made;
}

const query = new URLSearchParams(location.search).get("q") || "", terms = alternatives(query);
const results = terms[0] ? ranked(terms) : [], root = document.documentElement.dataset.content_root || "./";
for (const field of document.querySelectorAll("input[name=q]")) field.value = query;
document.getElementById("found").textContent = terms[0]
  ? `${results.length} page${results.length === 1 ? " has" : "s have"} ${terms.join(" or ")}.` : "Type words into the field of the menu.";
for (const [page, heading, text, anchor] of results) {
  const item = document.createElement("li"), link = document.createElement("a");
  link.href = `${root}${page}.html${anchor ? `#${anchor}` : ""}`;
  link.textContent = heading === titles[page] ? heading : `${titles[page]} › ${heading}`;
  item.append(link, excerpt(text, terms));
  document.getElementById("results").append(item);
}
