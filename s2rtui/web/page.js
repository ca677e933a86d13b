"use strict";

// Keys go to the terminal without a click on it.
function focusTerminal() {
  document.querySelector(".xterm-helper-textarea")?.focus();
}

addEventListener("load", focusTerminal);
addEventListener("focus", focusTerminal);
