//! Masks with one bit for each pixel.

use std::ops::Range;

use super::runs::Mask;

pub(super) const WORD_PIXELS: usize = u64::BITS as usize; // pixels of a word
pub(super) const TOGETHER: usize = 8; // words that are looked at together

/// A mask with one bit for each pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bits {
    /// Row by row, with an empty word before and after; bits beyond a row's end are empty.
    pub(super) words: Vec<u64>,
    width: usize,
    height: usize,
    /// Words of a row, a multiple of those that are looked at together.
    pub(super) stride: usize,
}

impl Bits {
    /// Returns an empty mask.
    pub fn new(width: usize, height: usize) -> Self {
        let stride = width.div_ceil(WORD_PIXELS).next_multiple_of(TOGETHER);
        Self { words: vec![0; stride * height + 2], width, height, stride }
    }

    /// Packs the pixels of an image of `width` columns, row by row.
    pub fn pack(values: &[bool], width: usize) -> Self {
        let mut made = Self::new(width, values.len() / width.max(1));
        let rows = values.chunks_exact(width.max(1)).zip(made.words[1..].chunks_mut(made.stride.max(1)));
        for (values, words) in rows {
            for (word, values) in words.iter_mut().zip(values.chunks(WORD_PIXELS)) {
                *word = pack(values);
            }
        }
        made
    }

    /// The words of the rows, without those before and after.
    pub(super) fn rows_mut(&mut self) -> &mut [u64] {
        let count = self.stride * self.height;
        &mut self.words[1..=count]
    }

    /// Returns the words of a row.
    #[inline(always)]
    pub(super) fn row(&self, row: usize) -> &[u64] {
        &self.words[1 + row * self.stride..][..self.stride]
    }

    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> bool {
        self.words[1 + y * self.stride + x / WORD_PIXELS] >> (x % WORD_PIXELS) & 1 != 0
    }

    /// Returns the word of a pixel, and the pixel's bit in it.
    #[inline(always)]
    pub(super) fn word(&self, k: usize) -> (usize, usize) {
        let (row, column) = (k / self.width, k % self.width);
        (1 + row * self.stride + column / WORD_PIXELS, column % WORD_PIXELS)
    }

    pub(super) fn set(&mut self, k: usize, value: bool) {
        let (word, bit) = self.word(k);
        self.words[word] = self.words[word] & !(1 << bit) | u64::from(value) << bit;
    }

    /// Returns the set pixels, ascending.
    pub fn pixels(&self) -> Vec<usize> {
        let mut found = Vec::new();
        for row in 0..self.height {
            for (k, &word) in self.row(row).iter().enumerate() {
                let mut left = word;
                while left != 0 {
                    found.push(row * self.width + k * WORD_PIXELS + left.trailing_zeros() as usize);
                    left &= left - 1;
                }
            }
        }
        found
    }

    /// Returns the columns and the rows that hold set pixels; None if there are none.
    pub fn find_bounds(&self) -> Option<[Range<usize>; 2]> {
        let some: Vec<usize> =
            (0..self.height).filter(|&row| self.row(row).iter().any(|&word| word != 0)).collect();
        let (&first, &last) = (some.first()?, some.last()?);
        let mut any = vec![0; self.stride];
        for &row in &some {
            any.iter_mut().zip(self.row(row)).for_each(|(any, word)| *any |= word);
        }
        let (left, right) =
            (any.iter().position(|&word| word != 0)?, any.iter().rposition(|&word| word != 0)?);
        let begin = left * WORD_PIXELS + any[left].trailing_zeros() as usize;
        let end = (right + 1) * WORD_PIXELS - any[right].leading_zeros() as usize;
        Some([begin..end, first..last + 1])
    }

    /// Returns the pixels at most `reach` pixels from a set one.
    pub fn grown(&self, reach: f64) -> Self {
        let mut made = Self::new(self.width, self.height);
        let square = |away: usize| ((away * away) as f32).sqrt();
        let most = (0..).take_while(|&down| f64::from(square(down)) <= reach).count();
        let mut wide = vec![0; self.stride];
        for down in 0..most {
            let beside = |across: usize| f64::from(((across * across + down * down) as f32).sqrt()) <= reach;
            let across = (1..).take_while(|&across| beside(across)).count();
            for row in 0..self.height {
                if self.row(row).iter().all(|&word| word == 0) {
                    continue;
                }
                wide.copy_from_slice(self.row(row));
                for _ in 0..across {
                    spread(&mut wide);
                }
                for to in [row.checked_sub(down), Some(row + down)]
                    .into_iter()
                    .flatten()
                    .filter(|&to| to < self.height)
                {
                    let own = &mut made.words[1 + to * self.stride..][..self.stride];
                    own.iter_mut().zip(&wide).for_each(|(own, wide)| *own |= wide);
                }
            }
        }
        made.clear_ends();
        made
    }

    /// Empties the bits beyond the rows' ends.
    fn clear_ends(&mut self) {
        let (stride, width) = (self.stride, self.width);
        for row in self.rows_mut().chunks_mut(stride.max(1)) {
            for (k, word) in row.iter_mut().enumerate() {
                *word &= select(k, &(0..width));
            }
        }
    }

    /// Returns the number of pixels that differ from most of their neighbours, and of the steps of the outline.
    pub fn count_odd_pixels(&self) -> [usize; 2] {
        let beyond = vec![0; self.stride];
        let row = |row: Option<usize>| {
            row.filter(|&row| row < self.height).map_or(&beyond[..], |row| self.row(row))
        };
        let (mut odd, mut steps) = (0, 0);
        for y in 0..=self.height {
            let rows = [row(y.checked_sub(1)), row(Some(y)), row(Some(y + 1))];
            for k in 0..self.stride {
                // sums of three pixels of a row: its lower and its higher bit
                let sums = rows.map(|row| {
                    let before = row[k] << 1 | if k > 0 { row[k - 1] >> (WORD_PIXELS - 1) } else { 0 };
                    let after = row[k] >> 1 | row.get(k + 1).map_or(0, |next| next << (WORD_PIXELS - 1));
                    [before ^ row[k] ^ after, two_of_three([before, row[k], after]), before]
                });
                let own = rows[1][k];
                steps += (rows[0][k] ^ own).count_ones() + (own ^ sums[1][2]).count_ones();
                let carry = two_of_three([sums[0][0], sums[1][0], sums[2][0]]);
                let single = sums[0][0] ^ sums[1][0] ^ sums[2][0];
                let [a, b, c] = [sums[0][1], sums[1][1], sums[2][1]];
                let two = two_of_three([a, b, c]);
                let twice = two | carry & (a | b | c);
                let thrice = two & carry | a & b & c;
                odd += ((thrice | twice & single) ^ own).count_ones();
            }
            // beyond the last word
            steps += (rows[1].last().map_or(0, |word| word >> (WORD_PIXELS - 1))) as u32;
        }
        [odd as usize, steps as usize]
    }

    /// Returns how far the nearest empty pixel of a row is from a column; None if there is none.
    #[inline(always)]
    pub(super) fn measure_across(&self, row: usize, x: usize) -> Option<usize> {
        let words = self.row(row);
        let (word, bit) = (x / WORD_PIXELS, x % WORD_PIXELS);
        let after = !words[word] >> bit;
        // most strands are narrower than a word
        let right = if after != 0 {
            Some(after.trailing_zeros() as usize)
        } else {
            (word + 1..words.len())
                .find(|&k| words[k] != u64::MAX)
                .map(|k| k * WORD_PIXELS + words[k].trailing_ones() as usize - x)
        };
        let before = !words[word] << (WORD_PIXELS - 1 - bit);
        let left = if before != 0 {
            Some(before.leading_zeros() as usize)
        } else {
            (0..word)
                .rfind(|&k| words[k] != u64::MAX)
                .map(|k| x + 1 + words[k].leading_ones() as usize - (k + 1) * WORD_PIXELS)
        };
        // empty bits beyond the row's end are no pixels
        right.filter(|right| x + right < self.width).into_iter().chain(left).min()
    }

    /// Unpacks pixels of a row from column `first` on, which is in the image, to 0 and 1. Beyond its end, they are of no use.
    #[inline(always)]
    pub(super) fn unpack(&self, row: usize, first: usize, to: &mut [u8]) {
        let words = &self.words[1 + row * self.stride + first / WORD_PIXELS..];
        let shift = first % WORD_PIXELS;
        let at = |k: usize| words.get(k).copied().unwrap_or(0);
        for (k, to) in to.chunks_mut(WORD_PIXELS).enumerate() {
            let word = at(k) >> shift | at(k + 1) << 1 << (WORD_PIXELS - 1 - shift);
            let mut eights = [0u64; 8];
            for (n, eight) in eights.iter_mut().enumerate() {
                // each of eight bytes keeps a bit of its own, and carries it to its lowest
                let mut byte = word >> (8 * n) & 0xff;
                byte |= byte << 8;
                byte |= byte << 16;
                byte |= byte << 32;
                let own = byte & 0x8040_2010_0804_0201;
                *eight = (own + 0x7f7f_7f7f_7f7f_7f7f) >> 7 & 0x0101_0101_0101_0101;
            }
            let bytes = eights.map(u64::to_le_bytes);
            to.copy_from_slice(&bytes.as_flattened()[..to.len()]);
        }
    }
}

/// Returns which pixels are set in two of three masks at least.
#[inline(always)]
fn two_of_three([a, b, c]: [u64; 3]) -> u64 {
    a & b | c & (a | b)
}

/// Grows a row's pixels by one to each side.
fn spread(row: &mut [u64]) {
    let mut before = 0;
    for k in 0..row.len() {
        let own = row[k];
        let after = row.get(k + 1).map_or(0, |next| next << (WORD_PIXELS - 1));
        row[k] = own | own << 1 | own >> 1 | before >> (WORD_PIXELS - 1) | after;
        before = own;
    }
}

/// Packs at most 64 pixels, the first into the lowest bit.
#[inline(always)]
pub(super) fn pack(values: &[bool]) -> u64 {
    let (eights, rest) = values.as_chunks::<8>();
    let mut word = 0;
    for (k, eight) in eights.iter().enumerate() {
        // the product gathers the lowest bits of the bytes in its highest byte
        let byte = u64::from_le_bytes(eight.map(u8::from)).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        word |= byte << (8 * k);
    }
    for (k, &value) in rest.iter().enumerate() {
        word |= u64::from(value) << (8 * eights.len() + k);
    }
    word
}

/// Returns the bits of a word, the number of which is given, that are in a range of columns.
#[inline(always)]
pub(super) fn select(word: usize, columns: &Range<usize>) -> u64 {
    let first = columns.start.saturating_sub(word * WORD_PIXELS).min(WORD_PIXELS);
    let last = columns.end.saturating_sub(word * WORD_PIXELS).min(WORD_PIXELS);
    let below = |count: usize| if count < WORD_PIXELS { (1 << count) - 1 } else { u64::MAX };
    below(last) & !below(first)
}

impl Mask for Bits {
    fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    #[inline]
    fn find_next(&self, row: usize, from: usize, value: bool) -> usize {
        let words = self.row(row);
        let flipped = if value { 0 } else { u64::MAX };
        let mut kept = u64::MAX << (from % WORD_PIXELS);
        for (k, word) in words.iter().enumerate().skip(from / WORD_PIXELS) {
            let found = (word ^ flipped) & kept;
            if found != 0 {
                return (k * WORD_PIXELS + found.trailing_zeros() as usize).min(self.width);
            }
            kept = u64::MAX;
        }
        self.width
    }

    fn fill(&mut self, row: usize, columns: Range<usize>, value: bool) {
        let own = &mut self.words[1 + row * self.stride..][..self.stride];
        for k in columns.start / WORD_PIXELS..columns.end.div_ceil(WORD_PIXELS) {
            let chosen = select(k, &columns);
            own[k] = if value { own[k] | chosen } else { own[k] & !chosen };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_packed_found_filled_and_unpacked() {
        let (width, height) = (150, 3);
        let value = |k: usize| k % 7 < 3 && k % 50 > 20;
        let values: Vec<bool> = (0..width * height).map(value).collect();
        let mut bits = Bits::pack(&values, width);
        assert_eq!(bits.pixels(), (0..width * height).filter(|&k| value(k)).collect::<Vec<_>>());
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            assert_eq!(bits.at(x, y), value(y * width + x));
            for of in [false, true] {
                let expected = (x..width).find(|&x| value(y * width + x) == of).unwrap_or(width);
                assert_eq!(bits.find_next(y, x, of), expected);
            }
            let mut found = [2; 80];
            bits.unpack(y, x, &mut found);
            let expected = (x..width.min(x + 80)).map(|x| u8::from(value(y * width + x)));
            assert!(found.iter().copied().zip(expected).all(|(a, b)| a == b));
        }
        assert_eq!(bits.find_next(0, width, true), width);
        bits.fill(1, 60..130, true);
        bits.fill(1, 64..128, false);
        let row: Vec<usize> = (0..width).filter(|&x| bits.at(x, 1)).collect();
        let kept = |x: usize| value(width + x) && !(60..130).contains(&x);
        let expected = (0..width).filter(|&x| kept(x) || (60..64).contains(&x) || (128..130).contains(&x));
        assert_eq!(row, expected.collect::<Vec<_>>());
    }

    #[test]
    fn masks_grow_and_their_odd_pixels_count_as_by_pixel() {
        let (width, height) = (128, 40);
        let value = |x: usize, y: usize| {
            (x * x + 3 * y * y + x * y).is_multiple_of(11) && x % 40 > 22 && y != 20 || x > 126
        };
        let values: Vec<bool> = (0..width * height).map(|k| value(k % width, k / width)).collect();
        let bits = Bits::pack(&values, width);
        let at = |x: isize, y: isize| {
            (0..width as isize).contains(&x)
                && (0..height as isize).contains(&y)
                && value(x as usize, y as usize)
        };
        for reach in [0.0, 1.0, 1.5, 2.3] {
            let grown = bits.grown(reach);
            let away = 3isize;
            for (y, x) in (0..height as isize).flat_map(|y| (0..width as isize).map(move |x| (y, x))) {
                let near = (-away..=away)
                    .flat_map(|b| (-away..=away).map(move |a| (a, b)))
                    .any(|(a, b)| ((a * a + b * b) as f64).sqrt() <= reach && at(x + a, y + b));
                assert_eq!(grown.at(x as usize, y as usize), near, "{reach}: {x}, {y}");
            }
        }
        let (mut odd, mut steps) = (0, 0);
        for (y, x) in (0..=height as isize).flat_map(|y| (0..=width as isize).map(move |x| (y, x))) {
            let near = (-1..2).flat_map(|b| (-1..2).map(move |a| (a, b)));
            odd += usize::from((near.filter(|(a, b)| at(x + a, y + b)).count() > 4) != at(x, y));
            steps += usize::from(at(x, y) != at(x - 1, y)) + usize::from(at(x, y) != at(x, y - 1));
        }
        assert_eq!(bits.count_odd_pixels(), [odd, steps]);
        let some: Vec<(usize, usize)> =
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|&(x, y)| value(x, y)).collect();
        let ends = |of: fn(&(usize, usize)) -> usize| {
            some.iter().map(of).min().unwrap()..some.iter().map(of).max().unwrap() + 1
        };
        assert_eq!(bits.find_bounds(), Some([ends(|p| p.0), ends(|p| p.1)]));
        assert_eq!(Bits::new(70, 3).find_bounds(), None);
    }
}
