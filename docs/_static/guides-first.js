// A search finds guides before the reference, whose names stand in many of its pages.
var Scorer = {
  score: ([page, , , , score]) => score - (page.startsWith("reference/") ? 1000 : /^(changes|contributing)$/.test(page) ? 100 : 0),
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
