/* Light and dark themes for both pages, stored under the key of Furo, the site's theme, so that all pages agree. */
'use strict';

/** Sets the document's theme and the text of `button`, which switches themes; calls `repaint` at the start and after each change. */
function startTheme(button, repaint) {
  const dark = matchMedia('(prefers-color-scheme: dark)');
  let theme = 'auto';
  try { theme = localStorage.getItem('theme') || 'auto'; } catch { /* no storage: the system's theme */ }
  const paint = () => {
    document.documentElement.dataset.theme = theme === 'dark' || theme === 'auto' && dark.matches ? 'dark' : 'light';
    button.textContent = {auto: '◐ Auto', light: '◐ Light', dark: '◐ Dark'}[theme] || '◐ Auto';
    repaint();
  };
  button.onclick = () => {
    theme = {auto: 'light', light: 'dark', dark: 'auto'}[theme] || 'auto';
    try { localStorage.setItem('theme', theme); } catch { /* no storage: for this visit only */ }
    paint();
  };
  dark.addEventListener('change', paint);
  addEventListener('storage', (event) => { if (event.key === 'theme') { theme = event.newValue || 'auto'; paint(); } });
  paint();
}
