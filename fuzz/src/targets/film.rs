//! Pictures: files that are streamed, and the tiles that they are made of.

use std::path::PathBuf;
use std::sync::OnceLock;

use bulbfold::engine::Recipe;
use bulbfold::files::Target;
use bulbfold::film::{Made, PngFile, PngForm, Tile, read_made_bytes, read_png_bytes, windows};
use bulbfold::shade::Size;

/// A made PNG that `--resume` looks at; the first two bytes are the size that it must have. What it says of how it was made is read, too,
/// and checked as `render` does.
pub fn png(bytes: &[u8]) {
    let [width, height, file @ ..] = bytes else { return };
    let size = Size { width: u32::from(*width).max(1), height: u32::from(*height).max(1) };
    if let Ok(Made { recipe: Some(recipe), .. }) = read_made_bytes(file) {
        let _ = Recipe::read(&recipe).map(|recipe| recipe.is_settled());
    }
    match read_png_bytes(file, size) {
        Ok(made) => assert_eq!(Ok(made), read_png_bytes(file, size)),
        Err(why) => assert!(!why.is_empty(), "a picture was refused without a reason"),
    }
}

/// A picture cut in tiles, filled through windows, pushed in pieces of any length, and read again.
pub fn film(bytes: &[u8]) {
    let byte = |i: usize| u32::from(bytes.get(i).copied().unwrap_or(1));
    let size = Size { width: 1 + byte(0) % 70, height: 1 + byte(1) % 70 };
    let all = Tile { x: 0, y: 0, width: size.width, height: size.height };
    let edge = 1 + byte(2) % 40;
    let mut seen = vec![0_u8; all.count()];
    for window in &mut windows(all, &mut seen, edge) {
        for place in window.tile.pixels() {
            window.set(place, 1);
        }
        assert_eq!(window.tile.rows().map(|row| row.places().len()).sum::<usize>(), window.tile.count());
    }
    assert!(seen.iter().all(|count| *count == 1), "tiles of {edge} leave pixels of {size:?} out");
    let group = all.grouped(byte(3) % 6);
    assert!(group.width << (byte(3) % 6) >= size.width, "squares do not cover the picture");
    let rgb: Vec<u8> = (0..all.count() * 3).map(|i| byte(4 + i % 97) as u8).collect();
    stream(size, &rgb, bytes);
}

/// Pushes a picture in pieces that the bytes choose; too few and too many rows must be errors.
fn stream(size: Size, rgb: &[u8], bytes: &[u8]) {
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    let path = PATH.get_or_init(|| std::env::temp_dir().join(format!("bulbfold-fuzz-{}.png", std::process::id())));
    let key = (!bytes.is_empty()).then(|| format!("key {}", bytes[0]));
    let target = Target::of(path).expect("the temporary folder can be looked at");
    let mut file = PngFile::at(&target, PngForm { key: key.clone(), ..PngForm::plain(size) });
    let mut pieces = bytes.iter().map(|byte| 1 + usize::from(*byte) * 7).cycle();
    let mut rest = rgb;
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(pieces.next().unwrap_or(rest.len()).min(rest.len()));
        file.push(piece.to_vec());
        rest = after;
    }
    let broken = bytes.last().map_or(9, |byte| byte % 9);
    match broken {
        0 => drop(file.push(vec![0; 3])),
        1 => return drop(file),
        _ => {}
    }
    let finished = file.finish();
    assert_eq!(finished.is_ok(), broken != 0, "{finished:?}");
    if finished.is_ok() {
        let written = std::fs::read(path).expect("the file is written");
        let made = read_png_bytes(&written, size).expect("what was written is whole");
        assert_eq!(made.key, key);
        assert!(read_png_bytes(&written[..written.len() - 1], size).is_err(), "a part counts as whole");
        std::fs::remove_file(path).expect("the file is there");
    }
    assert!(!path.exists(), "a picture that was not finished has a file");
}
