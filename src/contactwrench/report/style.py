"""The report's style sheet."""

STYLE = """
:root { --ink: #1f262d; --soft: #66707a; --line: #dde3e8; --good: #1d7a4b; --weak: #b3541e; }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; color: var(--ink);
  max-width: 70rem; margin: 2.5rem auto 3rem; padding: 0 1.5rem; background: #fff; }
h1 { font-size: 1.7rem; margin: 0 0 .6rem; letter-spacing: -.01em; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: 1.4rem; border-top: 2px solid var(--ink);
  overflow-wrap: anywhere; }
h3 { font-size: 1rem; margin: 1.8rem 0 .5rem; }
p { max-width: 48rem; margin: .5rem 0; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .9rem; }
th, td { text-align: right; padding: .22rem .7rem .22rem 0; white-space: nowrap; }
th { font-weight: 600; }
th:first-child { text-align: left; }
thead th { color: var(--soft); font-weight: 500; border-bottom: 1px solid var(--line); white-space: normal;
  vertical-align: bottom; }
tbody tr + tr > *, tr + tr > * { border-top: 1px solid var(--line); }
td.unit, th.unit { text-align: left; white-space: normal; }
td.fact, .facts td { text-align: left; white-space: normal; overflow-wrap: anywhere; }
td.said, th.said { text-align: left; white-space: normal; min-width: 18rem; max-width: 34rem; }
.scroll { overflow-x: auto; max-width: 100%; }
.unit { color: var(--soft); font-size: .85rem; }
.side-by-side { display: flex; flex-wrap: wrap; gap: 1rem 2.5rem; }
.side-by-side > * { min-width: 0; }
.verdict { border-left: 5px solid var(--good); background: #f1f8f4; padding: .8rem 1.1rem; margin: 1rem 0; }
.verdict strong { color: var(--good); }
.verdict.weak { border-color: var(--weak); background: #fdf4ee; }
.verdict.weak strong { color: var(--weak); }
.verdict ul { margin: .4rem 0 0; padding-left: 1.2rem; }
figure { margin: .8rem 0 1rem; }
figure svg { max-width: 100%; min-width: 34rem; height: auto; }
figure img { max-width: 100%; height: auto; }
figcaption { color: var(--soft); font-size: .85rem; max-width: 48rem; }
details { margin: .8rem 0; }
summary { cursor: pointer; color: var(--soft); }
footer { margin-top: 3rem; padding-top: .8rem; border-top: 1px solid var(--line); color: var(--soft);
  font-size: .85rem; }
@media (max-width: 40rem) { body { margin: 1.2rem auto 2rem; padding: 0 .9rem; } }
@media print { body { margin: 0; max-width: none; } details { display: none; } }
"""
