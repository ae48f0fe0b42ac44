// The search of MkDocs works in a web worker and fetches its index, both of which browsers refuse to pages that were
// opened as files.  There, this stands in for the worker: it searches in the page, with the index as a script.
if (location.protocol === "file:") {
  window.Worker = class {
    constructor(worker) {
      const folder = worker.replace("worker.js", "");
      const load = (name, then) => document.head.append(Object.assign(document.createElement("script"), {src: folder + name, onload: then}));
      load("lunr.js", () => load("search_index.js", () => this.begin(SEARCH_INDEX)));
    }
    begin({config, docs}) {
      lunr.tokenizer.separator = new RegExp(config.separator);
      this.docs = new Map(docs.map((doc) => [doc.location, {...doc, summary: doc.text.substring(0, 200)}]));
      this.index = lunr(function () {
        this.ref("location");
        this.field("title");
        this.field("text");
        docs.forEach((doc) => this.add(doc));
      });
      this.onmessage({data: {config}});
      this.onmessage({data: {allowSearch: true}});
    }
    postMessage({query}) {
      if (query && this.index) {
        this.onmessage({data: {results: this.index.search(query).map(({ref}) => this.docs.get(ref))}});
      }
    }
  };
}
