/* Light and dark for both pages, by the key of Furo, the style of the site, so that all pages agree. */
'use strict';

/** Keeps the document's theme and the text of `button`, which goes through the themes; `repaint` follows each change and the start. */
function startTheme(button, repaint) {
  const dark = matchMedia('(prefers-color-scheme: dark)');
  let theme = 'auto';
  try { theme = localStorage.getItem('theme') || 'auto'; } catch { /* no storage: as the system has it */ }
  const paint = () => {
    document.documentElement.dataset.theme = theme === 'dark' || theme === 'auto' && dark.matches ? 'dark' : 'light';
    button.textContent = {auto: '◐ Auto', light: '◐ Light', dark: '◐ Dark'}[theme] || '◐ Auto';
    repaint();
  };
  button.onclick = () => {
    theme = {auto: 'light', light: 'dark', dark: 'auto'}[theme] || 'auto';
    try { localStorage.setItem('theme', theme); } catch { /* for this visit */ }
    paint();
  };
  dark.addEventListener('change', paint);
  addEventListener('storage', (event) => { if (event.key === 'theme') { theme = event.newValue || 'auto'; paint(); } });
  paint();
}
