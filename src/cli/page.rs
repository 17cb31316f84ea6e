//! Pages of the reference: the same content as plain text for terminals and as Markdown for the documentation.

use std::fmt::Write as _;

/// A part of a page.
#[derive(Clone, Debug)]
pub enum Block {
    /// A heading of this level, 1 the topmost.
    Heading(usize, String),
    /// A paragraph.
    Text(String),
    /// A table: its head, then its rows.
    Table(Vec<&'static str>, Vec<Vec<String>>),
    /// Text that stands as it is, with the language for highlighting.
    Code(&'static str, String),
}

/// The page as Markdown; `level` is added to every heading.
pub fn markdown(blocks: &[Block], level: usize) -> String {
    let mut text = String::new();
    for block in blocks {
        match block {
            Block::Heading(depth, title) => {
                let _ = writeln!(text, "{} {title}\n", "#".repeat(depth + level));
            }
            Block::Text(paragraph) => {
                let _ = writeln!(text, "{}\n", paragraph.replace('*', "\\*"));
            }
            Block::Table(head, rows) => {
                let _ = writeln!(text, "| {} |\n|{}", head.join(" | "), "---|".repeat(head.len()));
                for row in rows {
                    let cells: Vec<String> = row.iter().map(|cell| escaped(cell)).collect();
                    let _ = writeln!(text, "| {} |", cells.join(" | "));
                }
                text.push('\n');
            }
            Block::Code(language, code) => {
                let _ = writeln!(text, "```{language}\n{}\n```\n", code.trim_end());
            }
        }
    }
    text
}

/// A cell of a table; code keeps its asterisks.
fn escaped(cell: &str) -> String {
    let cell = cell.replace('|', "\\|");
    if cell.starts_with('`') { cell } else { cell.replace('*', "\\*") }
}

/// The page as plain text.
pub fn plain(blocks: &[Block]) -> String {
    let mut text = String::new();
    for block in blocks {
        match block {
            Block::Heading(1, title) => {
                let _ = writeln!(text, "{title}\n{}\n", "=".repeat(title.chars().count()));
            }
            Block::Heading(_, title) => {
                let _ = writeln!(text, "{title}\n{}\n", "-".repeat(title.chars().count()));
            }
            Block::Text(paragraph) => {
                let _ = writeln!(text, "{paragraph}\n");
            }
            Block::Table(head, rows) => text.push_str(&plain_table(head, rows)),
            Block::Code(_, code) => {
                for line in code.trim_end().lines() {
                    let _ = writeln!(text, "{}", format!("    {line}").trim_end());
                }
                text.push('\n');
            }
        }
    }
    text
}

fn plain_table(head: &[&'static str], rows: &[Vec<String>]) -> String {
    let mut lines: Vec<Vec<String>> = vec![head.iter().map(ToString::to_string).collect()];
    lines.extend(rows.iter().cloned());
    let width =
        |i: usize| lines.iter().filter_map(|line| line.get(i)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let mut text = String::new();
    for line in &lines {
        let cells: Vec<String> = line.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
        let _ = writeln!(text, "  {}", cells.join("  ").trim_end());
    }
    text.push('\n');
    text
}
