// Browsers start no worker from a file on disk. There, a frame of the page does the work of the search.
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.srcdoc = `<script>
        window.IFrameWorker = true;
        postMessage = data => frameElement.answer(data);
        importScripts = (...urls) => Promise.all(urls.map(url => new Promise((resolve, reject) => {
          const script = document.createElement("script");
          Object.assign(script, {src: url, onload: resolve, onerror: reject});
          document.head.append(script);
        })));
      <\/script><script src="${new URL(url, document.baseURI)}"><\/script>`;
      frame.answer = data => this.dispatchEvent(new MessageEvent("message", {data}));
      this.loaded = new Promise(resolve => frame.addEventListener("load", resolve));
      this.frame = frame;
      document.body.append(frame);
    }
    postMessage(data) {
      this.loaded.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", {data})));
    }
    terminate() {
      this.frame.remove();
    }
  };
}
