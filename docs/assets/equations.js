/* Sets what stands between two lines of $$ on a page. */
for (const place of document.querySelectorAll("div.arithmatex")) {
  katex.render(place.textContent.trim().slice(2, -2), place, { displayMode: true, throwOnError: false })
}
