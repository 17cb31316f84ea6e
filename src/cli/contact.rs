//! Contact sheets: many pictures on a page, with numbers or captions.

use bulbfold::chart::{Drawing, GREY, Item, Text, raster};
use bulbfold::files::Target;
use bulbfold::film::Image;
use bulbfold::shade::Size;

use super::output::not_written;
use super::{Failure, Outcome, message};

/// Space around pictures, size of numbers on them, size of captions and of what stands below these.
const SPACE: f64 = 8.0;
const NUMBER: f64 = 18.0;
const CAPTION: f64 = 13.0;
const NOTE: f64 = 11.0;
/// Height of a line, in sizes of its text.
const LINE: f64 = 1.45;

/// A picture of a sheet.
#[derive(Default)]
pub struct Cell {
    /// The picture; none leaves its place free.
    pub picture: Option<Image>,
    /// A number or name in its corner.
    pub corner: String,
    /// What stands below it.
    pub caption: String,
    /// What stands below that, in lines of smaller text.
    pub notes: Vec<String>,
}

/// Columns of so many pictures where nothing else decides.
pub fn columns_of(count: usize) -> usize {
    ((count as f64).sqrt().ceil() as usize).clamp(1, 6)
}

/// Writes a sheet of pictures of this size.
pub fn write(target: &Target, cells: Vec<Cell>, size: Size, columns: usize, title: &str) -> Outcome {
    let page = raster(&sheet(cells, size, columns, title), 1.0);
    let page = page.map_err(|error| Failure::Work(message(&error, "ask for fewer or smaller pictures")))?;
    page.write_png_to(target).map_err(|error| not_written(target, &error))
}

/// The pictures on one page.
fn sheet(cells: Vec<Cell>, size: Size, columns: usize, title: &str) -> Drawing {
    let rows = cells.len().div_ceil(columns);
    let has_captions = cells.iter().any(|cell| !cell.caption.is_empty());
    let notes = cells.iter().map(|cell| cell.notes.len()).max().unwrap_or(0) as f64;
    let below = if has_captions { LINE * (CAPTION + NOTE * notes) } else { 0.0 };
    let picture = [f64::from(size.width), f64::from(size.height)];
    let [width, height] = [picture[0] + SPACE, picture[1] + below + SPACE];
    let mut page = Drawing::new(columns as f64 * width + SPACE, rows as f64 * height + SPACE, title);
    for (i, cell) in cells.into_iter().enumerate() {
        let [left, top] = [SPACE + (i % columns) as f64 * width, SPACE + (i / columns) as f64 * height];
        if let Some(image) = cell.picture {
            page.items.push(Item::Picture([left, top, picture[0], picture[1]], image));
        }
        if !cell.corner.is_empty() {
            let corner = Text::new([left + SPACE, top + SPACE + NUMBER * 0.7], cell.corner, NUMBER);
            page.text(corner.bold().halo());
        }
        let mut base = top + picture[1] + LINE * CAPTION * 0.8;
        page.text(fitting(&cell.caption, CAPTION, [left, base], picture[0]).bold());
        for note in &cell.notes {
            base += LINE * NOTE;
            page.text(fitting(note, NOTE, [left, base], picture[0]).colour(GREY));
        }
    }
    page
}

/// A line of text that is no wider than its picture.
fn fitting(text: &str, size: f64, at: [f64; 2], width: f64) -> Text {
    let whole = Text::new(at, text, size);
    if whole.width() <= width {
        return whole;
    }
    let mut kept: Vec<char> = text.chars().collect();
    loop {
        kept.pop();
        let cut = Text::new(at, kept.iter().collect::<String>().trim_end().to_string() + "...", size);
        if cut.width() <= width || kept.is_empty() {
            return cut;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{CAPTION, Cell, columns_of, fitting, sheet};
    use bulbfold::shade::Size;

    #[test]
    fn captions_are_no_wider_than_pictures() {
        let long = "a name that is far too long for a picture of this size";
        let text = fitting(long, CAPTION, [0.0; 2], 100.0);
        assert!(text.width() <= 100.0 && text.text.ends_with("...") && text.text.len() > 8, "{text:?}");
        assert_eq!(fitting("short", CAPTION, [0.0; 2], 100.0).text, "short");
    }

    #[test]
    fn pages_have_room_for_captions_where_there_are_any() {
        let size = Size { width: 100, height: 60 };
        let cells = |caption: &str| (0..5).map(|_| Cell { caption: caption.into(), ..Cell::default() }).collect();
        let [bare, named] = ["", "a"].map(|caption| sheet(cells(caption), size, 3, "pictures"));
        assert_eq!((bare.width, bare.height), (3.0 * 108.0 + 8.0, 2.0 * 68.0 + 8.0));
        assert_eq!((named.width, named.height), (bare.width, bare.height + 2.0 * 1.45 * 13.0));
        assert_eq!([1, 4, 5, 100].map(columns_of), [1, 2, 3, 6]);
    }
}
