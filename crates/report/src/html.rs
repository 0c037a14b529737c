//! The frame around a report's figures.

/// Replaces what HTML would take for markup.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A whole page.
pub(super) fn page(title: &str, body: &str) -> String {
    page_with_style(title, "", body)
}

/// A whole page with a style of its own.
pub(super) fn page_with_style(title: &str, style: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{}</title>\n<style>{STYLE}{style}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escape(title)
    )
}

/// A figure with what it shows and what to see in it.
pub(super) fn figure(svg: &str, caption: &str) -> String {
    format!("<figure>\n{svg}\n<figcaption>{caption}</figcaption>\n</figure>\n")
}

const STYLE: &str = "
:root { --ink: #1b2733; --soft: #5b6b7a; --line: #d8dee4; --good: #1a7f4b; --bad: #b3261e; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: #fff;
       max-width: 1120px; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.7rem; margin: 0 0 .25rem; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 .5rem; border-top: 1px solid var(--line);
     padding-top: 1.5rem; }
p { margin: .4rem 0; max-width: 75ch; }
.soft { color: var(--soft); }
.good { color: var(--good); font-weight: 600; }
.bad { color: var(--bad); font-weight: 600; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 1rem 0; }
th, td { padding: .3rem .7rem; text-align: right; border-bottom: 1px solid var(--line);
         white-space: nowrap; }
th { font-weight: 600; vertical-align: bottom; }
th small { display: block; font-weight: 400; color: var(--soft); }
th:nth-child(-n+2), td:nth-child(-n+2) { text-align: left; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 26rem), 1fr));
        gap: 1rem; }
figure { margin: 1rem 0; }
figure { overflow-x: auto; }
figure svg { width: 100%; min-width: 32rem; height: auto; display: block; }
figcaption { color: var(--soft); font-size: .9rem; max-width: 75ch; }
details { margin-top: 2rem; }
code { font-size: .85em; overflow-wrap: anywhere; }
@media print { body { max-width: none; } h2 { break-before: page; } }
";
