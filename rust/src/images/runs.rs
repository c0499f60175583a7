//! Masks that are read and filled by runs of a row.

use std::ops::Range;

/// A mask that is read and filled by runs of a row.
pub trait Mask {
    /// Its columns and rows.
    fn size(&self) -> [usize; 2];

    /// Returns the first column of a row from `from` on with a value, or the number of columns if there is none.
    fn find_next(&self, row: usize, from: usize, value: bool) -> usize;

    /// Fills columns of a row.
    fn fill(&mut self, row: usize, columns: Range<usize>, value: bool);
}
