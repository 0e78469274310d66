// Starts the language server, and shows the live window beside the editor.
const { spawn } = require("node:child_process");
const { randomBytes } = require("node:crypto");
const path = require("node:path");
const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client = null;
const previews = new Map(); // path of a file -> Preview

const setting = (name) => vscode.workspace.getConfiguration("maquette").get(name);
const allowed = () => setting("allow").flatMap((folder) => ["--allow", folder]);

function activate(context) {
  context.subscriptions.push(
    vscode.commands.registerCommand("maquette.preview", (uri) => preview(uri ?? vscode.window.activeTextEditor?.document.uri)),
    vscode.workspace.onDidChangeTextDocument(({ document }) => send(document)),
    vscode.workspace.onDidSaveTextDocument((document) => setTimeout(() => send(document), 300)), // the text is that of the file then
    vscode.workspace.onDidChangeConfiguration((change) => { if (change.affectsConfiguration("maquette")) restart(); }),
  );
  return start();
}

async function start() {
  const server = { command: setting("command"), args: ["lsp", ...allowed()] };
  client = new LanguageClient("maquette", "maquette", server, { documentSelector: [{ language: "scene" }] });
  try {
    await client.start();
  } catch (error) {
    client = null;
    explain(error);
  }
}

async function restart() {
  await client?.stop().catch(() => {});
  await start();
}

async function deactivate() {
  for (const shown of [...previews.values()]) shown.panel.dispose();
  await client?.stop();
}

async function explain(error) {
  const choice = "Open Settings";
  const text = `maquette does not start (${error.message ?? error}). Install it with pip install maquette-render, or set maquette.command.`;
  if (await vscode.window.showErrorMessage(text, choice) === choice) vscode.commands.executeCommand("workbench.action.openSettings", "maquette");
}

function preview(uri) {
  if (uri?.scheme !== "file") return vscode.window.showInformationMessage("Open a .scene file first.");
  const shown = previews.get(uri.fsPath);
  if (shown) shown.panel.reveal(undefined, true);
  else previews.set(uri.fsPath, new Preview(uri.fsPath));
}

// The unsaved text of a source goes to every preview: the page takes those of its scene's files.
function send(document) {
  if (document.languageId !== "scene" || document.uri.scheme !== "file") return;
  for (const shown of previews.values()) shown.panel.webview.postMessage({ path: document.uri.fsPath, text: document.getText() });
}

class Preview {
  constructor(file) {
    this.file = file;
    const column = { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true };
    this.panel = vscode.window.createWebviewPanel("maquette.preview", `Preview ${path.basename(file)}`, column, { enableScripts: true, retainContextWhenHidden: true });
    this.panel.onDidDispose(() => { previews.delete(file); this.process.kill("SIGINT"); });
    this.panel.webview.onDidReceiveMessage((message) => this.take(message));
    const args = ["watch", file, "--no-browser", ...allowed(), ...setting("preview.arguments")];
    this.process = spawn(setting("command"), args, { cwd: path.dirname(file), env: { ...process.env, PYTHONUNBUFFERED: "1" } });
    this.process.on("error", (error) => { this.panel.dispose(); explain(error); });
    this.output = "";
    this.process.stdout.on("data", (data) => this.read(data));
    this.process.stderr.on("data", (data) => { this.output += data; });
    this.process.on("exit", (code) => {
      if (code && previews.has(file)) vscode.window.showErrorMessage(`maquette watch has ended: ${this.output.trim().split("\n").at(-1) ?? code}`);
    });
  }

  async read(data) {
    this.output += data;
    const found = /http:\/\/127\.0\.0\.1:\d+\/[\w-]+\//.exec(this.output);
    if (!found || this.panel.webview.html) return;
    const address = await vscode.env.asExternalUri(vscode.Uri.parse(found[0]));
    this.panel.webview.html = page(address.toString(true));
  }

  async take(message) {
    if (message.type === "ready") vscode.workspace.textDocuments.filter((document) => document.isDirty).forEach(send);
    if (message.type !== "jump" || typeof message.path !== "string") return;
    const at = new vscode.Position(Math.max(0, message.line - 1), Math.max(0, message.column - 1));
    const document = await vscode.workspace.openTextDocument(message.path);
    const editors = vscode.window.visibleTextEditors.filter((editor) => editor.document === document);
    await vscode.window.showTextDocument(document, { viewColumn: editors[0]?.viewColumn ?? vscode.ViewColumn.One, selection: new vscode.Range(at, at) });
  }
}

function page(address) {
  const nonce = randomBytes(16).toString("hex");
  const origin = new URL(address).origin;
  const policy = `default-src 'none'; frame-src ${origin}; style-src 'unsafe-inline'; script-src 'nonce-${nonce}'`;
  return `<!doctype html><html><head><meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="${policy}">
<style>html, body, iframe { width: 100%; height: 100%; margin: 0; padding: 0; border: 0; display: block; }</style></head>
<body><iframe src="${address}" title="maquette"></iframe><script nonce="${nonce}">
const frame = document.querySelector("iframe"), editor = acquireVsCodeApi();
addEventListener("message", (event) => {
  if (event.source === frame.contentWindow) { if (event.origin === "${origin}") editor.postMessage(event.data); }
  else frame.contentWindow.postMessage(event.data, "${origin}");
});
</script></body></html>`;
}

module.exports = { activate, deactivate };
