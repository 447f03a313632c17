// The panel of settings: reads and writes a settings object, and says what is going on.

const find = (id) => document.getElementById(id);

const kModeNames = { color: 'colour', normal: 'normals', depth: 'depth' };

function options(select, entries) {
  select.replaceChildren(
    ...entries.map(([value, text]) => {
      const option = document.createElement('option');
      option.value = value;
      option.textContent = text;
      return option;
    }),
  );
}

/** What can be shown of a file. */
function modesOf(info) {
  const modes = Object.entries(kModeNames);
  if (info.attribute) modes.push(['attribute', info.attribute]);
  return modes;
}

export class Panel {
  /**
   * @param settings  mode, lit, background, fov, ortho, clip, compare, split, lodError, fly.
   * @param changed   is called with the name of a setting that the reader has changed.
   */
  constructor(files, settings, changed) {
    this.files = files;
    this.settings = settings;
    this.changed = changed;
    find('name').textContent = files.map((file) => file.name).join(' and ');
    find('facts').textContent = files.map((file) => file.facts).join('; ');
    find('hidden').textContent = files.map((file) => file.hidden).filter(Boolean).join('; ');
    options(find('mode'), modesOf(files[0]));
    const others = files.length > 1 ? [['file', files[1].name]] : [];
    const modes = modesOf(files[0]).map(([value, text]) => [value, text]);
    options(find('compare'), [['', 'nothing'], ...others, ...modes, ['lit', 'the other light']]);
    find('levels').hidden = files.every((file) => file.levels === 1);
    this.bind('mode', 'mode', 'value');
    this.bind('lit', 'lit', 'checked');
    this.bind('background', 'background', 'value');
    this.bind('fov', 'fov', 'valueAsNumber');
    this.bind('ortho', 'ortho', 'checked');
    this.bind('axis', 'clipAxis', 'value');
    this.bind('place', 'clipPlace', 'valueAsNumber');
    this.bind('flip', 'clipFlip', 'checked');
    this.bind('compare', 'compare', 'value');
    this.bind('error', 'lodError', 'valueAsNumber');
    this.bind('fly', 'fly', 'checked');
    this.dragSplit();
    this.show();
  }

  bind(id, name, property) {
    const element = find(id);
    element.addEventListener('input', () => {
      this.settings[name] = element[property];
      this.show();
      this.changed(name);
    });
    this.bound ??= [];
    this.bound.push([element, name, property]);
  }

  /** Writes the settings into the panel. */
  show() {
    for (const [element, name, property] of this.bound) {
      if (element[property] !== this.settings[name]) element[property] = this.settings[name];
    }
    const compared = this.settings.compare !== '';
    find('split').hidden = !compared;
    find('split').style.left = `${100 * this.settings.split}%`;
    find('clip').hidden = this.settings.clipAxis === '';
    find('fov-text').textContent = `${Math.round(this.settings.fov)}°`;
    find('error-text').textContent = `${this.settings.lodError} px`;
  }

  dragSplit() {
    const bar = find('split');
    bar.addEventListener('pointerdown', (event) => bar.setPointerCapture(event.pointerId));
    bar.addEventListener('pointermove', (event) => {
      if (!bar.hasPointerCapture(event.pointerId)) return;
      this.settings.split = Math.max(0, Math.min(1, event.clientX / window.innerWidth));
      this.show();
      this.changed('split');
    });
    bar.addEventListener('keydown', (event) => {
      const by = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.code];
      if (!by) return;
      this.settings.split = Math.max(0, Math.min(1, this.settings.split + by));
      this.show();
      this.changed('split');
    });
  }

  onClick(id, action) {
    find(id).addEventListener('click', action);
  }

  say(text) {
    find('status').textContent = text;
  }

  /** Puts a text on the clipboard; where that is not allowed the reader can select it. */
  async copy(text) {
    const field = find('copied');
    field.value = text;
    field.hidden = false;
    field.rows = text.split('\n').length + 2;
    try {
      await navigator.clipboard.writeText(text);
      this.say('Copied.');
    } catch {
      field.focus();
      field.select();
      this.say(document.execCommand('copy') ? 'Copied.' : 'Press Ctrl+C to copy.');
    }
  }
}
