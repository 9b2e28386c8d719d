import { mount } from "svelte";
import App from "./App.svelte";
import { wantedTongue } from "./i18n/index.svelte";
import { learnAll } from "./i18n/server.svelte";
import { follow } from "./store.svelte";
import "./style.css";

// The server is asked while the sentences and the first place are fetched.
follow();
// The first sentence is in the person's own language already.
await learnAll(wantedTongue()).catch(() => {});
const target = document.getElementById("app");
if (target) mount(App, { target });
