"use strict";
// Search: every word must be in the words of an asset, as with `dxb library WORDS`.
const search = document.getElementById("search");
const cards = [...document.querySelectorAll(".asset")];

function filter() {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const card of cards) {
    const fits = words.every((word) => card.dataset.words.includes(word));
    card.hidden = !fits;
    shown += fits;
  }
  document.getElementById("shown").textContent = words.length ? `${shown} of ${cards.length}` : "";
  document.getElementById("empty").hidden = shown > 0;
}

search.addEventListener("input", filter);
filter();
