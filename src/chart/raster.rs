//! A drawing as pixels, at any scale.

use tiny_skia::{
    Color, FillRule, FilterQuality, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, PixmapPaint, Rect, Stroke,
    StrokeDash, Transform,
};

use super::drawing::{Colour, Drawing, Item, PAPER, Point, Text};
use super::font;
use crate::film::Image;
use crate::shade::Size;

/// Largest edge of a PNG.
const MAX_EDGE: f64 = 30_000.0;

/// Draws at `scale` pixels a unit. Errors where the picture would be too large.
pub fn raster(drawing: &Drawing, scale: f64) -> Result<Image, String> {
    let (width, height) = ((drawing.width * scale).ceil(), (drawing.height * scale).ceil());
    let size = Size { width: width.min(MAX_EDGE + 1.0) as u32, height: height.min(MAX_EDGE + 1.0) as u32 };
    let pixmap = if width.max(height) > MAX_EDGE { None } else { Pixmap::new(size.width, size.height) };
    let Some(mut pixmap) = pixmap else {
        return Err(format!("a chart of {width} x {height} pixels is too large for a PNG; write an SVG"));
    };
    pixmap.fill(Color::WHITE);
    let mut canvas = Canvas { pixmap, scale: scale as f32 };
    for item in &drawing.items {
        canvas.draw(item)?;
    }
    let rgb = canvas.pixmap.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect();
    Ok(Image { size, rgb })
}

struct Canvas {
    pixmap: Pixmap,
    scale: f32,
}

impl Canvas {
    fn draw(&mut self, item: &Item) -> Result<(), String> {
        match item {
            Item::Rect([x, y, w, h], colour) => {
                if let Some(rect) = Rect::from_xywh(*x as f32, *y as f32, *w as f32, *h as f32) {
                    self.pixmap.fill_rect(rect, &paint(*colour), self.transform(), None);
                }
            }
            Item::Line { points, colour, width, dash } => {
                let dash = (*dash > 0.0).then(|| StrokeDash::new(vec![*dash as f32; 2], 0.0)).flatten();
                self.stroke(polyline(points, false), *colour, *width, dash, self.transform());
            }
            Item::Dots { points, diameter, colour } => {
                for [x, y] in points {
                    self.fill(PathBuilder::from_circle(*x as f32, *y as f32, *diameter as f32 / 2.0), *colour);
                }
            }
            Item::Ring { centre: [x, y], diameter, colour, width } => {
                let circle = PathBuilder::from_circle(*x as f32, *y as f32, *diameter as f32 / 2.0);
                self.stroke(circle, *colour, *width, None, self.transform());
            }
            Item::Area(points, colour) => self.fill(polyline(points, true), *colour),
            Item::Text(text) => self.text(text),
            Item::Picture(place, image) => self.picture(*place, image)?,
        }
        Ok(())
    }

    fn transform(&self) -> Transform {
        Transform::from_scale(self.scale, self.scale)
    }

    fn fill(&mut self, path: Option<Path>, colour: Colour) {
        if let Some(path) = path {
            self.pixmap.fill_path(&path, &paint(colour), FillRule::Winding, self.transform(), None);
        }
    }

    fn stroke(&mut self, path: Option<Path>, colour: Colour, width: f64, dash: Option<StrokeDash>, place: Transform) {
        let Some(path) = path else { return };
        let line_cap = if dash.is_some() { LineCap::Butt } else { LineCap::Round };
        let stroke = Stroke { width: width as f32, line_cap, line_join: LineJoin::Round, dash, ..Stroke::default() };
        self.pixmap.stroke_path(&path, &paint(colour), &stroke, place, None);
    }

    fn text(&mut self, text: &Text) {
        let scale = text.size as f32 / 100.0;
        let turn = if text.upright { -90.0 } else { 0.0 };
        let place = self
            .transform()
            .pre_translate(text.at[0] as f32, text.at[1] as f32)
            .pre_rotate(turn)
            .pre_translate(-text.lead() as f32, 0.0)
            .pre_scale(scale, -scale);
        let pen = text.pen() / f64::from(scale);
        let path = glyphs(&text.text);
        if text.halo {
            self.stroke(path.clone(), PAPER, pen + 3.6 / f64::from(scale), None, place);
        }
        self.stroke(path, text.colour, pen, None, place);
    }

    fn picture(&mut self, [x, y, w, h]: [f64; 4], image: &Image) -> Result<(), String> {
        let size = image.size;
        let mut source = Pixmap::new(size.width, size.height).ok_or("the picture is empty")?;
        for (pixel, rgb) in source.data_mut().chunks_exact_mut(4).zip(image.rgb.chunks_exact(3)) {
            pixel.copy_from_slice(&[rgb[0], rgb[1], rgb[2], 255]);
        }
        let place = self.transform().pre_translate(x as f32, y as f32);
        let place = place.pre_scale(w as f32 / size.width as f32, h as f32 / size.height as f32);
        let paint = PixmapPaint { quality: FilterQuality::Bicubic, ..PixmapPaint::default() };
        self.pixmap.draw_pixmap(0, 0, source.as_ref(), &paint, place, None);
        Ok(())
    }
}

fn paint(Colour(r, g, b): Colour) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(r, g, b, 255);
    paint
}

fn polyline(points: &[Point], close: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (i, [x, y]) in points.iter().enumerate() {
        match i {
            0 => path.move_to(*x as f32, *y as f32),
            _ => path.line_to(*x as f32, *y as f32),
        }
    }
    if close {
        path.close();
    }
    path.finish()
}

fn glyphs(text: &str) -> Option<Path> {
    let mut path = PathBuilder::new();
    let f = |[x, y]: Point| (x as f32, y as f32);
    for stroke in font::strokes(text) {
        match stroke {
            font::Stroke::Move(p) => path.move_to(f(p).0, f(p).1),
            font::Stroke::Line(p) => path.line_to(f(p).0, f(p).1),
            font::Stroke::Curve(a, b, c) => {
                let (a, b, c) = (f(a), f(b), f(c));
                path.cubic_to(a.0, a.1, b.0, b.1, c.0, c.1);
            }
        }
    }
    path.finish()
}
