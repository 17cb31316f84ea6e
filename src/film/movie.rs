//! Films in one file of bytes: GIF, animated PNG and animated WebP, frame by frame.

use std::io::{self, Write};

use image_webp::{ColorType, WebPEncoder};

use crate::shade::Size;

/// The formats.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum MovieFormat {
    /// 256 colours a frame, times in hundredths of a second.
    Gif,
    /// Bytes, without losses, exact times.
    Apng,
    /// Bytes, without losses, times in thousandths of a second.
    WebP,
}

/// What a film's file says before its frames.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct MovieForm {
    /// The format.
    pub format: MovieFormat,
    /// Columns and rows.
    pub size: Size,
    /// Frames.
    pub frames: u32,
    /// Seconds of a frame, as a fraction.
    pub frame_time: (u32, u32),
}

/// Takes frames of three bytes a pixel, and writes a film that repeats for ever.
pub struct Movie<W: Write> {
    form: MovieForm,
    done: u32,
    out: Out<W>,
}

enum Out<W: Write> {
    Gif(Box<gif::Encoder<W>>),
    Apng(png::Writer<W>),
    /// The frames so far: the file begins with its length.
    WebP(W, Vec<u8>),
}

impl<W: Write> Movie<W> {
    /// A film without frames.
    ///
    /// Errors: what the format or the writer says; GIF has at most 65,535 columns and rows, WebP 16,384.
    pub fn new(out: W, form: MovieForm) -> io::Result<Movie<W>> {
        let Size { width, height } = form.size;
        let out = match form.format {
            MovieFormat::Gif => {
                let edge = |edge: u32| u16::try_from(edge).map_err(io::Error::other);
                let mut gif = gif::Encoder::new(out, edge(width)?, edge(height)?, &[]).map_err(io::Error::other)?;
                gif.set_repeat(gif::Repeat::Infinite).map_err(io::Error::other)?;
                Out::Gif(Box::new(gif))
            }
            MovieFormat::Apng => {
                let mut png = png::Encoder::new(out, width, height);
                png.set_color(png::ColorType::Rgb);
                png.set_depth(png::BitDepth::Eight);
                png.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
                png.set_animated(form.frames, 0).map_err(io::Error::other)?;
                let [num, den] = fraction(form.frame_time);
                png.set_frame_delay(num, den).map_err(io::Error::other)?;
                Out::Apng(png.write_header().map_err(io::Error::other)?)
            }
            MovieFormat::WebP => Out::WebP(out, Vec::new()),
        };
        Ok(Movie { form, done: 0, out })
    }

    /// Time of a frame in units of a share of a second, so that all frames together last as long as they should.
    fn duration(&self, units: u64) -> u64 {
        let (num, den) = (u64::from(self.form.frame_time.0), u64::from(self.form.frame_time.1));
        let until = |frame: u64| (frame * num * units + den / 2) / den;
        until(u64::from(self.done) + 1) - until(u64::from(self.done))
    }

    /// Takes the next frame: three bytes a pixel, from the top left.
    ///
    /// Errors: what the format or the writer says.
    pub fn push(&mut self, rgb: &[u8]) -> io::Result<()> {
        let Size { width, height } = self.form.size;
        let time = self.duration(if self.form.format == MovieFormat::Gif { 100 } else { 1000 });
        match &mut self.out {
            Out::Gif(gif) => {
                let mut frame = gif::Frame::from_rgb_speed(width as u16, height as u16, rgb, GIF_SPEED);
                frame.delay = u16::try_from(time).unwrap_or(u16::MAX);
                gif.write_frame(&frame).map_err(io::Error::other)?;
            }
            Out::Apng(png) => png.write_image_data(rgb).map_err(io::Error::other)?,
            Out::WebP(_, frames) => {
                let mut picture = Vec::new();
                let encoder = WebPEncoder::new(&mut picture);
                encoder.encode(rgb, width, height, ColorType::Rgb8).map_err(io::Error::other)?;
                // Behind the file's head are the chunks of the picture.
                let data = picture.get(12..).unwrap_or_default();
                let mut frame = vec![0; 6];
                frame.extend(three(width - 1));
                frame.extend(three(height - 1));
                frame.extend(three(time.min(0xff_ffff) as u32));
                // Each frame replaces the one before.
                frame.push(0b10);
                frame.extend(data);
                chunk(frames, b"ANMF", &frame);
            }
        }
        self.done += 1;
        Ok(())
    }

    /// Ends the film.
    ///
    /// Errors: what the writer says.
    pub fn finish(self) -> io::Result<()> {
        match self.out {
            Out::Gif(gif) => gif.into_inner().map(drop).map_err(io::Error::other),
            Out::Apng(png) => png.finish().map_err(io::Error::other),
            Out::WebP(mut out, frames) => {
                let mut body = b"WEBP".to_vec();
                let mut head = vec![0b10, 0, 0, 0];
                head.extend(three(self.form.size.width - 1));
                head.extend(three(self.form.size.height - 1));
                chunk(&mut body, b"VP8X", &head);
                // Black behind everything, for ever.
                chunk(&mut body, b"ANIM", &[0, 0, 0, 255, 0, 0]);
                body.extend(frames);
                let length = u32::try_from(body.len()).map_err(io::Error::other)?;
                out.write_all(b"RIFF")?;
                out.write_all(&length.to_le_bytes())?;
                out.write_all(&body)
            }
        }
    }
}

/// How hard the palette of a GIF's frame is looked for, from 1 (best) to 30.
const GIF_SPEED: i32 = 10;

/// A fraction whose parts have 16 bits.
fn fraction((num, den): (u32, u32)) -> [u16; 2] {
    let exact = u16::try_from(num).ok().zip(u16::try_from(den).ok());
    exact.map_or_else(|| [(1e4 * f64::from(num) / f64::from(den)).round() as u16, 10_000], |(num, den)| [num, den])
}

/// Three bytes, the least first.
fn three(number: u32) -> [u8; 3] {
    let [a, b, c, _] = number.to_le_bytes();
    [a, b, c]
}

/// Appends a chunk of a RIFF file (WebP container specification, Google, 2023).
fn chunk(to: &mut Vec<u8>, name: &[u8; 4], data: &[u8]) {
    to.extend(name);
    to.extend((data.len() as u32).to_le_bytes());
    to.extend(data);
    if data.len() % 2 == 1 {
        to.push(0);
    }
}

#[cfg(test)]
mod tests {
    use super::{Movie, MovieForm, MovieFormat};
    use crate::shade::Size;

    /// Five frames of plain colours, at 24 frames a second.
    fn film(format: MovieFormat) -> Vec<u8> {
        let form = MovieForm { format, size: Size { width: 7, height: 5 }, frames: 5, frame_time: (1, 24) };
        let mut bytes = Vec::new();
        let mut movie = Movie::new(&mut bytes, form).expect("it begins");
        for frame in 0..5u8 {
            movie.push(&[frame * 50, 255 - frame * 50, 7].repeat(35)).expect("it takes frames");
        }
        movie.finish().expect("it ends");
        bytes
    }

    #[test]
    fn gifs_have_all_frames_and_last_as_long_as_they_should() {
        let bytes = film(MovieFormat::Gif);
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(&bytes[..]).expect("it is a GIF");
        let mut frames = Vec::new();
        while let Some(frame) = decoder.read_next_frame().expect("it is whole") {
            frames.push((frame.delay, frame.buffer[0]));
        }
        assert_eq!(frames.iter().map(|frame| u32::from(frame.0)).sum::<u32>(), 21, "{frames:?}");
        assert_eq!(frames.iter().map(|frame| frame.1).collect::<Vec<u8>>(), [0, 50, 100, 150, 200]);
    }

    #[test]
    fn animated_pngs_have_all_frames() {
        let bytes = film(MovieFormat::Apng);
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().expect("it is a PNG");
        let mut frames = Vec::new();
        for _ in 0..5 {
            let mut pixels = vec![0; reader.output_buffer_size().expect("it has a size")];
            reader.next_frame(&mut pixels).expect("it has the frame");
            let control = reader.info().frame_control.expect("it is a film");
            frames.push((control.delay_num, control.delay_den, pixels[0]));
        }
        let expected = [0, 50, 100, 150, 200].map(|first| (1, 24, first));
        assert_eq!(frames, expected);
    }

    #[test]
    fn animated_webps_have_all_frames() {
        let bytes = film(MovieFormat::WebP);
        let mut decoder = image_webp::WebPDecoder::new(std::io::Cursor::new(&bytes)).expect("it is a WebP");
        assert_eq!((decoder.num_frames(), decoder.dimensions()), (5, (7, 5)));
        let mut frames = Vec::new();
        for _ in 0..5 {
            let mut pixels = vec![0; decoder.output_buffer_size().expect("it has a size")];
            let time = decoder.read_frame(&mut pixels).expect("it has the frame");
            frames.push((time, pixels[0]));
        }
        let expected = [(42, 0), (41, 50), (42, 100), (42, 150), (41, 200)];
        assert_eq!(frames, expected);
    }
}
