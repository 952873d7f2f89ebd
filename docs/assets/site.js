// The search has a name; what scrolls sideways can be reached by the keyboard.
addEventListener("load", () => {
  document.querySelector(".md-search[role=dialog]")?.setAttribute("aria-label", "Search");
  for (const box of document.querySelectorAll(".md-typeset__scrollwrap, .md-typeset pre > code")) box.tabIndex = 0;
});

// The gallery of faults: show those whose name or sentence has every word that is typed.
addEventListener("load", () => {
  const box = document.querySelector(".fault-search"), count = document.querySelector(".fault-count");
  if (!box) return;
  const faults = [...document.querySelectorAll(".fault")];
  const search = () => {
    const words = box.value.toLowerCase().split(/\s+/);
    for (const fault of faults) fault.hidden = !words.every((word) => fault.textContent.toLowerCase().includes(word));
    for (const group of document.querySelectorAll(".faults"))
      group.hidden = group.previousElementSibling.hidden = !group.querySelector(".fault:not([hidden])");
    count.textContent = `${faults.filter((fault) => !fault.hidden).length} of ${faults.length}`;
  };
  box.addEventListener("input", search);
  search();
});
