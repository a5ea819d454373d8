//! Least-cost assignment of rows (tracks) to columns (detections) of which any may stay alone.
//!
//! Shortest augmenting paths with potentials (R. Jonker and A. Volgenant, 1987) on each connected
//! group of allowed pairs: gating leaves few and small groups, so a hundred tracks cost little more
//! than a hundred times one.

/// An allowed pair and its cost relative to leaving both alone; only pairs of negative cost can
/// gain anything.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Index of the row.
    pub row: usize,
    /// Index of the column.
    pub column: usize,
    /// Cost of the pair minus the cost of leaving both alone.
    pub cost: f64,
}

/// The column of each of `rows` rows in the assignment of least total cost; `None` where the row
/// stays alone. Pairs of equal row and column must not repeat; ties go to the earlier column.
pub fn assign(rows: usize, columns: usize, pairs: &[Pair]) -> Vec<Option<usize>> {
    let mut result = vec![None; rows];
    let pairs: Vec<Pair> = pairs.iter().copied().filter(|p| p.cost < 0.0).collect();
    // Groups by union-find over rows and, behind them, columns.
    let mut parent: Vec<usize> = (0..rows + columns).collect();
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    for pair in &pairs {
        let a = root(&mut parent, pair.row);
        let b = root(&mut parent, rows + pair.column);
        parent[a.max(b)] = a.min(b);
    }
    let mut grouped: Vec<(usize, Pair)> = pairs
        .iter()
        .map(|pair| (root(&mut parent, pair.row), *pair))
        .collect();
    grouped.sort_by_key(|(group, pair)| (*group, pair.row, pair.column));
    for group in grouped.chunk_by(|a, b| a.0 == b.0) {
        match group {
            [(_, pair)] => result[pair.row] = Some(pair.column),
            _ => solve(group, &mut result),
        }
    }
    result
}

/// Solves one group densely. Each row also has a column of its own at cost zero, which stands for
/// staying alone.
fn solve(group: &[(usize, Pair)], result: &mut [Option<usize>]) {
    let mut row_ids: Vec<usize> = group.iter().map(|(_, pair)| pair.row).collect();
    let mut column_ids: Vec<usize> = group.iter().map(|(_, pair)| pair.column).collect();
    row_ids.dedup();
    column_ids.sort_unstable();
    column_ids.dedup();
    let (n, real) = (row_ids.len(), column_ids.len());
    let m = real + n;
    const FORBIDDEN: f64 = 1e12;
    let mut cost = vec![FORBIDDEN; n * m];
    for (_, pair) in group {
        if let (Ok(i), Ok(j)) = (
            row_ids.binary_search(&pair.row),
            column_ids.binary_search(&pair.column),
        ) {
            cost[i * m + j] = pair.cost;
        }
    }
    for i in 0..n {
        cost[i * m + real + i] = 0.0;
    }
    // Columns are counted from 1; column 0 stands for the row that looks for one.
    let (mut u, mut v) = (vec![0.0; n + 1], vec![0.0; m + 1]);
    let mut owner = vec![0; m + 1];
    let mut way = vec![0; m + 1];
    for i in 1..=n {
        owner[0] = i;
        let mut j0 = 0;
        let mut least = vec![f64::INFINITY; m + 1];
        let mut used = vec![false; m + 1];
        while owner[j0] != 0 {
            used[j0] = true;
            let i0 = owner[j0];
            let (mut delta, mut j1) = (f64::INFINITY, 0);
            for j in 1..=m {
                if used[j] {
                    continue;
                }
                let reduced = cost[(i0 - 1) * m + j - 1] - u[i0] - v[j];
                if reduced < least[j] {
                    least[j] = reduced;
                    way[j] = j0;
                }
                if least[j] < delta {
                    delta = least[j];
                    j1 = j;
                }
            }
            for j in 0..=m {
                if used[j] {
                    u[owner[j]] += delta;
                    v[j] -= delta;
                } else {
                    least[j] -= delta;
                }
            }
            j0 = j1;
        }
        while j0 != 0 {
            owner[j0] = owner[way[j0]];
            j0 = way[j0];
        }
    }
    for j in 1..=real {
        if owner[j] != 0 {
            result[row_ids[owner[j] - 1]] = Some(column_ids[j - 1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    fn total(pairs: &[Pair], assigned: &[Option<usize>]) -> f64 {
        pairs
            .iter()
            .filter(|pair| assigned[pair.row] == Some(pair.column))
            .map(|pair| pair.cost)
            .sum()
    }

    /// Least cost by trying everything.
    fn exhaustive(row: usize, rows: usize, taken: &mut Vec<usize>, pairs: &[Pair]) -> f64 {
        if row == rows {
            return 0.0;
        }
        let mut best = exhaustive(row + 1, rows, taken, pairs);
        for pair in pairs.iter().filter(|pair| pair.row == row) {
            if !taken.contains(&pair.column) {
                taken.push(pair.column);
                best = best.min(pair.cost + exhaustive(row + 1, rows, taken, pairs));
                taken.pop();
            }
        }
        best
    }

    #[test]
    fn nearest_first_is_not_the_least_total() {
        // Greedy takes (0, 0) at -9 and leaves row 1 alone; the least total is -8 - 7.
        let pair = |row, column, cost| Pair { row, column, cost };
        let pairs = [pair(0, 0, -9.0), pair(0, 1, -8.0), pair(1, 0, -7.0)];
        assert_eq!(assign(2, 2, &pairs), vec![Some(1), Some(0)]);
    }

    #[test]
    fn agrees_with_exhaustive_search() {
        let mut rng = Stream::new(5, 0, "assignment");
        for _ in 0..500 {
            let (rows, columns) = (1 + (rng.uniform() * 6.0) as usize, 6);
            let mut pairs = Vec::new();
            for row in 0..rows {
                for column in 0..columns {
                    if rng.uniform() < 0.4 {
                        let cost = rng.range(-10.0, 3.0);
                        pairs.push(Pair { row, column, cost });
                    }
                }
            }
            let assigned = assign(rows, columns, &pairs);
            let mut used: Vec<usize> = assigned.iter().flatten().copied().collect();
            used.sort_unstable();
            assert!(used.windows(2).all(|w| w[0] != w[1]), "a column twice");
            let best = exhaustive(0, rows, &mut Vec::new(), &pairs);
            assert!((total(&pairs, &assigned) - best).abs() < 1e-9);
        }
    }
}
