// A list whose rows stay in place while their content changes, so that focus does.

export class KeyedList {
  #list; #make; #rows = new Map();

  /** `make` returns the row of a key. */
  constructor(list, make) {
    this.#list = list;
    this.#make = make;
  }

  /** Shows `items`, each with a `key`, in their order; `update` writes an item into its row. */
  render(items, update) {
    const rows = items.map((item) => {
      const row = this.#rows.get(item.key) ?? this.#make(item);
      this.#rows.set(item.key, row);
      update(row, item);
      return row;
    });
    const kept = new Set(items.map(({ key }) => key));
    for (const [key, row] of this.#rows) {
      if (kept.has(key)) continue;
      row.remove();
      this.#rows.delete(key);
    }
    const focused = document.activeElement;
    rows.forEach((row, i) => {
      if (this.#list.children[i] !== row) this.#list.insertBefore(row, this.#list.children[i] ?? null);
    });
    if (focused !== document.activeElement && this.#list.contains(focused)) focused.focus({ preventScroll: true });
  }
}

/** A button "50 more" below a list that shows a part of what there is. */
export class More {
  #button; #step; #most;

  constructor(button, step, changed) {
    this.#button = button;
    this.#step = this.#most = step;
    button.addEventListener("click", () => { this.#most += this.#step; changed(); });
  }

  cut(items) {
    const rest = items.length - this.#most;
    this.#button.hidden = rest <= 0;
    const text = `Show ${Math.min(rest, this.#step)} of ${rest} more`;
    if (this.#button.textContent !== text) this.#button.textContent = text;
    return items.slice(0, this.#most);
  }
}
