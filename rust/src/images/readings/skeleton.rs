//! Skeletons of masks as networks of pixels.

use crate::images::image::Image;
use crate::images::thinning::find_whole_skeleton;

const MARGIN: usize = 2; // pixels around a mask that thinning needs

/// The lines of a mask's skeleton, and the groups of pixels where they meet.
pub struct Traced {
    /// Mean row and column of each group.
    pub groups: Vec<[f64; 2]>,
    /// Rows and columns of each line's pixels, and the number of the group at each end; -1 for none.
    pub lines: Vec<(Vec<[i64; 2]>, [i64; 2])>,
}

/// Thins a mask and traces the lines of its skeleton.
pub fn trace(mask: &Image<bool>) -> Traced {
    let (width, height) = (mask.width + 2 * MARGIN, mask.height + 2 * MARGIN);
    let mut framed = Image::filled(width, height, false);
    for (row, values) in mask.values.chunks_exact(mask.width.max(1)).enumerate() {
        framed.values[(row + MARGIN) * width + MARGIN..][..mask.width].copy_from_slice(values);
    }
    let net = Net::new(find_whole_skeleton(&framed), width);
    let place = |i: usize| [net.pixels[i] / width - MARGIN, net.pixels[i] % width - MARGIN].map(|x| x as i64);
    let meeting: Vec<bool> = (0..net.len()).map(|i| net.near(i).len() >= 3).collect();
    let (numbers, count) = net.groups(&meeting);
    let (mut groups, mut sizes) = (vec![[0.0; 2]; count], vec![0.0; count]);
    for (i, &number) in numbers.iter().enumerate().filter(|&(_, &number)| number != 0) {
        let k = number as usize - 1;
        sizes[k] += 1.0;
        for (sum, x) in groups[k].iter_mut().zip(place(i)) {
            *sum += x as f64;
        }
    }
    for (group, size) in groups.iter_mut().zip(sizes) {
        *group = group.map(|sum| sum / size);
    }
    let single: Vec<bool> = meeting.iter().map(|meets| !meets).collect();
    let lines = net.lines(&single, &numbers).into_iter().map(|line| {
        let pixels = line.path.iter().map(|&i| place(i as usize)).collect();
        (pixels, line.ends.map(|number| i64::from(number) - 1))
    });
    Traced { groups, lines: lines.collect() }
}

/// The pixels of a skeleton and their neighbours.
pub struct Net {
    /// Indices into the image, ascending.
    pub pixels: Vec<usize>,
    near: Vec<[u32; 8]>,
    degrees: Vec<u8>,
    width: usize,
}

/// A line of pixels, and the groups at its ends.
pub struct Line {
    /// Numbers of its pixels, in order.
    pub path: Vec<u32>,
    /// The number of the group that each end touches, from 1 on; 0 for none.
    pub ends: [u32; 2],
}

impl Net {
    /// Connects pixels, which ascend and are not on the image's border.
    pub fn new(pixels: Vec<usize>, width: usize) -> Self {
        let mut near = Vec::with_capacity(pixels.len());
        let mut degrees = Vec::with_capacity(pixels.len());
        // the first pixels that are not before the one above to the left, and below to the left
        let (mut above, mut below) = (0, 0);
        for (i, &k) in pixels.iter().enumerate() {
            let seek = |from: &mut usize, pixel: usize| {
                while *from < pixels.len() && pixels[*from] < pixel {
                    *from += 1;
                }
                [pixel, pixel + 1, pixel + 2]
                    .map(|pixel| (*from..pixels.len().min(*from + 3)).find(|&j| pixels[j] == pixel))
            };
            let [nw, n, ne] = seek(&mut above, k - width - 1);
            let [sw, s, se] = seek(&mut below, k + width - 1);
            let w = i.checked_sub(1).filter(|&j| pixels[j] + 1 == k);
            let e = Some(i + 1).filter(|&j| pixels.get(j) == Some(&(k + 1)));
            let (mut list, mut count) = ([0; 8], 0);
            // straight neighbours first, so that lines do not cut corners
            for j in [e, s, w, n, se, sw, ne, nw].into_iter().flatten() {
                list[count] = j as u32;
                count += 1;
            }
            near.push(list);
            degrees.push(count as u8);
        }
        Self { pixels, near, degrees, width }
    }

    /// Returns the distance between two touching pixels.
    pub fn step(&self, i: u32, j: u32) -> f64 {
        let away = self.pixels[i as usize].abs_diff(self.pixels[j as usize]);
        if away == 1 || away == self.width { 1.0 } else { std::f64::consts::SQRT_2 }
    }

    pub fn len(&self) -> usize {
        self.pixels.len()
    }

    /// The pixels that touch a pixel.
    #[inline]
    pub fn near(&self, i: usize) -> &[u32] {
        &self.near[i][..usize::from(self.degrees[i])]
    }

    /// Numbers the connected groups of chosen pixels from 1 on, 0 for other pixels; also returns the number of groups.
    pub fn groups(&self, chosen: &[bool]) -> (Vec<u32>, usize) {
        let mut numbers = vec![0u32; self.len()];
        let mut count = 0;
        let mut open = Vec::new();
        for start in 0..self.len() {
            if !chosen[start] || numbers[start] != 0 {
                continue;
            }
            count += 1;
            numbers[start] = count as u32;
            open.push(start);
            while let Some(i) = open.pop() {
                for &n in self.near(i) {
                    let n = n as usize;
                    if chosen[n] && numbers[n] == 0 {
                        numbers[n] = count as u32;
                        open.push(n);
                    }
                }
            }
        }
        (numbers, count)
    }

    /// Follows the chosen pixels as lines; `groups` numbers the groups that their ends may touch.
    pub fn lines(&self, chosen: &[bool], groups: &[u32]) -> Vec<Line> {
        let (numbers, count) = self.groups(chosen);
        let mut members = vec![Vec::new(); count];
        for (i, &number) in numbers.iter().enumerate() {
            if number != 0 {
                members[number as usize - 1].push(i);
            }
        }
        let mut taken = vec![false; self.len()];
        let inside = |i: usize| self.near(i).iter().filter(|&&n| chosen[n as usize]).count();
        members
            .iter()
            .map(|members| {
                let begin = members.iter().copied().find(|&i| inside(i) <= 1).unwrap_or(members[0]);
                let mut path = vec![begin as u32];
                taken[begin] = true;
                loop {
                    let last = path[path.len() - 1] as usize;
                    let next =
                        self.near(last).iter().copied().find(|&n| chosen[n as usize] && !taken[n as usize]);
                    let Some(n) = next else { break };
                    taken[n as usize] = true;
                    path.push(n);
                }
                let touched = |i: u32| {
                    let mut found: Vec<u32> = self
                        .near(i as usize)
                        .iter()
                        .map(|&n| groups[n as usize])
                        .filter(|&g| g != 0)
                        .collect();
                    found.sort_unstable();
                    found.dedup();
                    found
                };
                let first = touched(path[0]);
                let ends = if path.len() == 1 {
                    [first.first().copied().unwrap_or(0), first.get(1).copied().unwrap_or(0)]
                } else {
                    let last = touched(path[path.len() - 1]);
                    [first.first().copied().unwrap_or(0), last.last().copied().unwrap_or(0)]
                };
                Line { path, ends }
            })
            .collect()
    }
}
