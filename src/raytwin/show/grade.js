// Viewers of a student's page, mounted when they are opened.
for (const look of document.querySelectorAll("details.look")) {
  const open = () => {
    const data = look.querySelector("script");
    if (!look.open || !data || !globalThis.raytwin) return;
    raytwin.mount(look.querySelector(".viewer"), JSON.parse(data.textContent));
    data.remove();
  };
  look.addEventListener("toggle", open);
  open();
}
