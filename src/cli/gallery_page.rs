//! The page of `bulbfold gallery`: one HTML file with everything in it but the pictures.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use bulbfold::graph::{FractalParam, Preset, ValidGraph};
use bulbfold::shade::Size;

/// The page without its cards: style and script included.
const PAGE: &str = include_str!("templates/gallery.html");

/// What the page shows of a formula.
pub struct Card {
    /// Name.
    pub name: String,
    /// As commands take it.
    pub file: String,
    /// The rest; the messages of a broken formula.
    pub shown: Result<Shown, String>,
}

/// What there is of a formula that could be rendered.
pub struct Shown {
    /// The picture's path, from the page.
    pub picture: String,
    /// Its columns and rows.
    pub size: Size,
    /// The command that makes it.
    pub command: String,
    /// The file's text.
    pub formula: String,
    /// What was read from it.
    pub graph: ValidGraph,
}

/// Heading of formulas that name no group.
const NO_GROUP: &str = "other";
/// Heading of those that are broken.
const BROKEN: &str = "broken";

impl Card {
    fn group(&self) -> &str {
        match &self.shown {
            Ok(shown) if !shown.graph.group.is_empty() => &shown.graph.group,
            Ok(_) => NO_GROUP,
            Err(_) => BROKEN,
        }
    }
}

/// The page of these formulas; `made_by` stands at its end.
pub fn page(cards: &[Card], made_by: &str) -> String {
    let mut groups: BTreeMap<&str, usize> = BTreeMap::new();
    cards.iter().for_each(|card| *groups.entry(card.group()).or_default() += 1);
    let options: String = groups
        .iter()
        .map(|(group, count)| format!("<option value=\"{0}\">{0} ({count})</option>", escaped(group)))
        .collect();
    let shown: String = cards.iter().map(card_html).collect();
    // One pass, so that nothing in a formula's text is taken for a place of the template.
    let values =
        [("COUNT", cards.len().to_string()), ("GROUPS", options), ("CARDS", shown), ("MADE", escaped(made_by))];
    let mut parts = PAGE.split("{{");
    let mut text = parts.next().unwrap_or_default().to_string();
    for part in parts {
        let (name, rest) = part.split_once("}}").unwrap_or((part, ""));
        text.push_str(values.iter().find(|(known, _)| *known == name).map_or("", |(_, value)| value));
        text.push_str(rest);
    }
    text
}

fn card_html(card: &Card) -> String {
    let (name, group) = (escaped(&card.name), escaped(card.group()));
    match &card.shown {
        Err(why) => format!(
            "<article class=\"card broken\" id=\"{name}\" data-group=\"{group}\" data-text=\"{words}\">\
             <div class=\"noimage\" aria-hidden=\"true\">no picture</div><div class=\"body\"><h2>{name}</h2>\
             <p class=\"group\">{group}</p><p>{file} could not be rendered:</p><pre tabindex=\"0\">{why}</pre></div></article>\n",
            words = escaped(&format!("{} {} {why}", card.name, card.file).to_lowercase()),
            file = escaped(&card.file),
            why = escaped(why.trim_end()),
        ),
        Ok(shown) => {
            let graph = &shown.graph;
            format!(
                "<article class=\"card\" id=\"{name}\" data-group=\"{group}\" data-text=\"{words}\">\
                 <img src=\"{picture}\" width=\"{width}\" height=\"{height}\" loading=\"lazy\" alt=\"{alt}\">\
                 <div class=\"body\"><h2>{name}</h2><p class=\"group\">{group}</p><p>{summary}</p>\
                 <details><summary>Details of {name}</summary>{details}</details></div></article>\n",
                words = escaped(&words(card, graph)),
                picture = escaped(&shown.picture),
                width = shown.size.width,
                height = shown.size.height,
                alt = escaped(&format!("{}: {}", card.name, graph.summary)),
                summary = escaped(&graph.summary),
                details = details(shown),
            )
        }
    }
}

/// What the search looks in.
fn words(card: &Card, graph: &ValidGraph) -> String {
    let params = graph.params.iter().map(|p| format!("{} {}", p.name, p.help));
    let parts = [&card.name, card.group(), &graph.name, &graph.summary, &graph.inventor, &graph.source];
    let year = graph.year.map(|year| year.to_string());
    let presets = graph.presets.iter().map(|p| format!("{} {}", p.name, p.help));
    parts
        .into_iter()
        .map(|part| part.to_string())
        .chain(year)
        .chain(params)
        .chain(presets)
        .collect::<Vec<_>>()
        .join(" ")
        .to_lowercase()
}

fn details(shown: &Shown) -> String {
    let graph = &shown.graph;
    let mut text = String::from("<dl>");
    let year = graph.year.map(|year| year.to_string()).unwrap_or_default();
    for (name, value) in [("Inventor", &graph.inventor), ("Year", &year), ("Source", &graph.source)] {
        if !value.is_empty() {
            let _ = write!(text, "<dt>{name}</dt><dd>{}</dd>", escaped(value));
        }
    }
    text.push_str("</dl>");
    if !graph.params.is_empty() {
        let rows: String = graph.params.iter().map(param_row).collect();
        let _ = write!(
            text,
            "<h3>Parameters</h3><div class=\"wide\"><table><thead><tr><th scope=\"col\">Name<th scope=\"col\">Default\
             <th scope=\"col\">Range<th scope=\"col\">Unit<th scope=\"col\">Meaning</thead><tbody>{rows}</tbody></table></div>"
        );
    }
    if !graph.presets.is_empty() {
        let row = |preset: &Preset| {
            format!("<dt><code>--preset {}</code></dt><dd>{}</dd>", escaped(&preset.name), escaped(&preset.help))
        };
        let _ = write!(text, "<h3>Presets</h3><dl>{}</dl>", graph.presets.iter().map(row).collect::<String>());
    }
    let _ = write!(
        text,
        "<h3>Command</h3><div class=\"command\"><code>{0}</code><button type=\"button\" data-copy=\"{0}\">Copy</button></div>\
         <h3>Formula</h3><pre tabindex=\"0\">{1}</pre>",
        escaped(&shown.command),
        escaped(shown.formula.trim_end())
    );
    text
}

fn param_row(param: &FractalParam) -> String {
    let FractalParam { name, default, min, max, unit, help, .. } = param;
    format!(
        "<tr><th scope=\"row\"><code>{}</code><td>{default}<td>{min} to {max}<td>{}<td>{}",
        escaped(name),
        escaped(unit),
        escaped(help)
    )
}

/// Text as it stands in HTML, between tags and in quotes.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 16);
    for c in bulbfold::diag::printable(text).chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{Card, escaped, page};

    #[test]
    fn nothing_of_a_formula_is_taken_for_html() {
        let card = |name: &str| Card {
            name: name.into(),
            file: "{{CARDS}}.ron".into(),
            shown: Err("<script>alert('x')</script> & \"y\" {{COUNT}}".into()),
        };
        let text = page(&[card("a\"><b>"), card("b")], "test");
        assert_eq!(text.matches("<article").count(), 2);
        assert!(!text.contains("<script>alert") && !text.contains("a\"><b>"));
        assert!(text.contains("&amp; &quot;y&quot; {{COUNT}}"), "the text of a formula stays as it is");
        assert!(text.contains("<option value=\"broken\">broken (2)</option>"));
        assert_eq!(escaped("a<'b'>&"), "a&lt;&#39;b&#39;&gt;&amp;");
    }
}
