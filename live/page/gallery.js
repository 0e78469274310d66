// The scenes of a folder, with their pictures.
document.documentElement.dataset.theme =
  localStorage.getItem("maquette-theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
const root = document.getElementById("scenes");
const { folder, scenes } = await (await fetch("list.json")).json();
document.getElementById("name").textContent = folder;
document.title = `${folder} – maquette`;
const cards = scenes.map(({ key, name }) => {
  const card = document.createElement("a");
  card.href = `scene/${key}/`;
  card.dataset.name = name.toLowerCase();
  const picture = document.createElement("img");
  picture.loading = "lazy";
  picture.alt = "";
  picture.src = `thumbnail/${key}`;
  picture.addEventListener("error", async () => {
    const message = document.createElement("div");
    message.className = "broken";
    message.textContent = (await (await fetch(picture.src)).text()).trim();
    picture.replaceWith(message);
  });
  const label = document.createElement("b");
  label.textContent = name;
  card.append(picture, label);
  return card;
});
root.replaceChildren(...cards);
const count = () => {
  const shown = cards.filter((card) => !card.hidden).length;
  document.getElementById("count").textContent = `${shown} ${shown === 1 ? "scene" : "scenes"}`;
};
document.getElementById("filter").addEventListener("input", (event) => {
  for (const card of cards) card.hidden = !card.dataset.name.includes(event.target.value.toLowerCase());
  count();
});
count();
