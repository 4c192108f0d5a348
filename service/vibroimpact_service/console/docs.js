// Displays openapi.json as a page.

const make = (name, text, ...children) => {
  const made = document.createElement(name);
  if (text) made.textContent = text;
  made.append(...children);
  return made;
};

function rows(head, lines) {
  const table = make("table");
  table.append(make("thead", "", make("tr", "", ...head.map((text) => Object.assign(make("th", text), { scope: "col" })))));
  table.append(make("tbody", "", ...lines.map((line) => make("tr", "", ...line.map((text) => make("td", text))))));
  const box = make("div", "", table);
  box.className = "scroll";
  return box;
}

// A type in a few words: its name if it has one.
function typed(schema = {}) {
  if (schema.$ref) return schema.$ref.split("/").pop();
  if (schema.anyOf || schema.oneOf) return [...new Set((schema.anyOf || schema.oneOf).map(typed))].join(" or ");
  if (schema.enum) return schema.enum.map((v) => JSON.stringify(v)).join(", ");
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  if (schema.type === "array") return `list of ${typed(schema.items)}`;
  return schema.type || "anything";
}

function fields(schema) {
  const needed = new Set(schema.required || []);
  return Object.entries(schema.properties || {}).map(([name, part]) => [
    needed.has(name) ? name : `${name} (optional)`, typed(part), part.description || "",
  ]);
}

function operation(method, path, about) {
  const article = make("article");
  article.id = about.operationId;
  const mark = make("span", method.toUpperCase());
  mark.className = "method";
  article.append(make("h3", "", mark, ` ${path}`), make("p", `${about.summary}. ${about.description || ""}`));
  const scope = about.security && about.security[0].key;
  if (scope) article.append(make("p", `Scope of the key: ${scope.join(", ")}`));
  if (about.parameters) {
    article.append(rows(["Parameter", "Where", "Type", "Meaning"], about.parameters.map((p) => [p.name, p.in, typed(p.schema), p.description || ""])));
  }
  for (const [type, content] of Object.entries((about.requestBody || {}).content || {})) {
    article.append(make("p", `Body ${type}: ${typed(content.schema)}`));
    for (const example of Object.values(content.examples || {})) {
      const text = typeof example.value === "string" ? example.value : JSON.stringify(example.value, null, 1);
      article.append(make("details", "", make("summary", `Example: ${example.summary}`), make("pre", text)));
    }
  }
  const answers = Object.entries(about.responses).map(([status, answer]) => [
    status, answer.description, Object.entries(answer.content || {}).map(([type, c]) => `${type}: ${typed(c.schema)}`).join("; "),
  ]);
  article.append(make("details", "", make("summary", "Answers"), rows(["Status", "Meaning", "Content"], answers)));
  return article;
}

const contract = await (await fetch("/openapi.json")).json();
document.getElementById("title").textContent = `${contract.info.title} ${contract.info.version}`;
document.getElementById("about").textContent = contract.info.description;
const contents = make("ul");
const place = document.getElementById("operations");
for (const [path, methods] of Object.entries(contract.paths)) {
  for (const [method, about] of Object.entries(methods)) {
    place.append(operation(method, path, about));
    const link = make("a", `${method.toUpperCase()} ${path}`);
    link.href = `#${about.operationId}`;
    contents.append(make("li", "", link));
  }
}
for (const [name, schema] of Object.entries(contract.components.schemas)) {
  const article = make("article", "", make("h3", name), make("p", schema.description || ""));
  article.id = name;
  if (schema.properties) article.append(rows(["Field", "Type", "Meaning"], fields(schema)));
  else article.append(make("p", typed(schema)));
  place.append(article);
}
document.getElementById("contents").replaceChildren(contents);
