/* Files: open, save, save as, downloads; nothing is overwritten without a confirmation. */
"use strict";

class FileDialogs {
  constructor(page) {
    this.page = page;
    this.dialog = document.getElementById("dialog");
    this.written = new Set(); // names of files that this page has written: saving again needs no confirmation
    const actions = { open: () => this.open(), save: () => this.save(), "save-as": () => this.saveAs(), "download-text": () => this.download("text"), "download-page": () => this.download("recorded") };
    for (const [id, action] of Object.entries(actions)) document.getElementById(id).addEventListener("click", action);
  }

  /** Ask the user in a dialog with a form; resolves to the value, or null if it is closed. */
  _ask(title, contents, buttons) {
    const { dialog } = this, form = element("form"), row = element("p", "buttons");
    form.method = "dialog";
    const heading = element("h2", "", title);
    heading.id = "dialog-title";
    row.append(...buttons.map(([value, text]) => Object.assign(element("button", "", text), { value })), Object.assign(element("button", "", "Cancel"), { value: "", formNoValidate: true }));
    form.append(heading, ...contents, row);
    dialog.replaceChildren(form);
    dialog.returnValue = "";
    dialog.showModal();
    return new Promise((done) => { dialog.onclose = () => done(dialog.returnValue || null); });
  }

  async _confirmLoss() {
    if (!this.page.scenario.changed) return true;
    return (await this._ask("Changes are not saved", [element("p", "", "Another scenario replaces the present one and its changes.")], [["yes", "Open another scenario"]])) === "yes";
  }

  open() {
    this.page.request("files", {}, async ({ names }) => {
      if (!(await this._confirmLoss())) return;
      const list = element("div", "files");
      list.append(...names.map((name) => Object.assign(element("button", "", name), { value: name })));
      if (!names.length) list.append(element("p", "", "The folder has no scenario."));
      const name = await this._ask(`Open a scenario of ${this.page.welcome.folder}`, [list], []);
      if (name) this.page.request("open", { name }, (message) => this.page.opened(message.scenario, message.name));
    });
  }

  save() {
    const { name } = this.page.scenario;
    if (name) this._send(name, this.written.has(name));
    else this.saveAs();
  }

  async saveAs() {
    const { scenario } = this.page, input = element("input"), label = element("label", "", "Name of the file ");
    Object.assign(input, { type: "text", required: true, pattern: "[A-Za-z0-9_][A-Za-z0-9_.\\-]*", value: scenario.name ?? `${scenario.get("name") ?? "scenario"}.toml`, title: "letters, digits, dots, - and _" });
    label.append(input);
    if (!(await this._ask("Save as", [label], [["save", "Save"]]))) return;
    const name = input.value.endsWith(".toml") ? input.value : `${input.value}.toml`;
    this._send(name, false);
  }

  _send(name, overwrite) {
    const { page } = this, { scenario } = page, text = JSON.stringify(scenario.table);
    page.request("save", { name, scenario: scenario.table, base: scenario.name, overwrite }, async (message) => {
      if (message.type === "exists") {
        if (await this._ask(`${message.name} exists`, [element("p", "", "The file is replaced by the present scenario.")], [["yes", "Replace"]])) this._send(name, true);
        return;
      }
      this.written.add(message.name);
      scenario.saved(message.name, text);
      page.say(`Saved as ${message.name}.`);
    });
  }

  download(type) {
    const { scenario } = this.page, stem = (scenario.name ?? `${scenario.get("name") ?? "scenario"}.toml`).replace(/\.toml$/, "");
    this.page.request(type, { scenario: scenario.table, ...(type === "text" ? { base: scenario.name } : {}) }, (message) => {
      const address = URL.createObjectURL(new Blob([message.text ?? message.html], { type: type === "text" ? "application/toml" : "text/html" }));
      Object.assign(document.createElement("a"), { href: address, download: type === "text" ? `${stem}.toml` : `${stem}.html` }).click();
      setTimeout(() => URL.revokeObjectURL(address), 10000);
    });
  }
}
