// The order of results: titles and names that are sought first, then the sum of the ranks of the words
// (ranking.py). Sphinx's own scores choose between entries of one page.
var Scorer = {
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
  score: ([page, name, , , score, , kind]) => {
    const sought = (new URLSearchParams(window.location.search).get("q") ?? "").trim();
    const stemmer = new Stemmer();
    const words = (sought.match(/[\p{L}\p{N}_.+-]*[\p{L}\p{N}_]/gu) ?? []).map(
      (one) => stemmer.stemWord(one.toLowerCase()));
    const phrases = words.slice(1).map((word, k) => `${words[k]} ${word}`);
    const rank = [...words, ...phrases].reduce((sum, one) => sum + (RANKS[one]?.[page] ?? 0), 0);
    const last = name.split(/ > |\(in |\./).map((one) => one.trim().toLowerCase());
    const exact = kind === "index" ? score === 100 : name.toLowerCase() === sought.toLowerCase() ||
      last.includes(sought.toLowerCase());
    return rank + score / 1000 + (exact ? 100 : 0);
  },
};
