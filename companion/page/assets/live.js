'use strict';
// The page while it is live: follows the server's events, and comes back by itself when the service does. What was
// shown last stays.
(() => {
  document.body.classList.add('live');
  const panels = Panels(document.getElementById('page')), banner = document.getElementById('banner');
  let ended = false, heard = 0, commands = null, robots = [], aimedAt = '';

  const say = (words, kind) => { banner.textContent = words; banner.className = kind; };
  const cells = text => Uint8Array.from(atob(text), one => one.charCodeAt(0));

  function offerCommands() {
    if (commands) return;
    commands = document.createElement('p');
    for (const [name, ask, kind] of [['engage', 'Hand the vehicle to the companion? It arms, takes off and flies by itself.', ''],
      ['abort', 'End the companion’s flight? The vehicle holds, and is yours.', 'abort']]) {
      const button = document.createElement('button');
      button.textContent = name;
      button.className = kind;
      button.addEventListener('click', () => confirmed(name, ask));
      commands.append(button);
    }
    panels.mission.append(commands);
  }

  function confirmed(name, ask) {
    const dialog = document.createElement('dialog'), words = document.createElement('p');
    dialog.id = 'dialog';
    words.textContent = ask;
    const yes = document.createElement('button'), no = document.createElement('button');
    yes.textContent = `Yes, ${name}`;
    no.textContent = 'No';
    const which = document.createElement('select');
    which.setAttribute('aria-label', 'robot to fly to');
    which.append(...robots.map(robot => new Option(robot.name, robot.id, false, robot.name === aimedAt)));
    const choice = name === 'engage' && robots.length > 1;
    const close = () => { dialog.close(); dialog.remove(); };
    no.addEventListener('click', close);
    yes.addEventListener('click', async () => { close(); await command(name, choice ? which.value : null); });
    dialog.append(words, ...(choice ? ['to ', which, ' '] : []), yes, no);
    document.body.append(dialog);
    dialog.showModal();
    no.focus();
  }

  async function command(name, target) {
    const out = document.createElement('p');
    panels.mission.append(out);
    out.textContent = `${name} …`;
    try {
      const answer = await fetch(`command/${name}${target === null ? '' : `?target=${encodeURIComponent(target)}`}`, {method: 'POST', headers: {'X-Companion': name}});
      const told = answer.headers.get('content-type').startsWith('application/json') ? await answer.json() : {error: await answer.text()};
      out.textContent = told.ok ? `${name}: done` : `${name} refused: ${told.error}`;
    } catch (error) { out.textContent = `${name}: the page does not answer`; }
    setTimeout(() => out.remove(), 15000);
  }

  function show(view) {
    heard = performance.now();
    ended = view.ended;
    [robots, aimedAt] = [view.robots, view.target_name];
    document.title = `${view.name || 'companion'} ${view.mission ? view.mission.state : ''}`;
    const from = view.source === 'live' ? '' : `replay of ${view.source}, `;
    if (ended) say(`${view.name}: ${from}ended at ${view.t_s.toFixed(1)} s; this is how it ended`, 'quiet');
    else if (view.silent_s > 3 && view.source === 'live') say(`Nothing from the service for ${view.silent_s.toFixed(0)} s`, 'bad');
    else if (view.introduced) say(`${view.name}, ${view.role}: ${from}${view.t_s.toFixed(1)} s`, 'quiet');
    panels.show(view);
  }

  function follow() {
    const source = new EventSource('events');
    source.addEventListener('page', event => { if (JSON.parse(event.data).may_command) offerCommands(); });
    source.addEventListener('view', event => show(JSON.parse(event.data)));
    source.addEventListener('path', event => panels.path(JSON.parse(event.data)));
    source.addEventListener('profile', event => {
      const told = JSON.parse(event.data);
      panels.profile(told ? {...told, cells: cells(told.cells)} : null);
    });
    source.addEventListener('error', () => {
      if (!ended) say('The page has lost its service; what follows is old. Trying again …', 'bad');
      if (source.readyState === EventSource.CLOSED) setTimeout(follow, 3000);
    });
  }

  follow();
  setInterval(() => {
    if (!ended && heard && performance.now() - heard > 5000) say(`Nothing for ${((performance.now() - heard) / 1000).toFixed(0)} s; what follows is old`, 'bad');
  }, 1000);
})();
