//! Methods whose receiver proves that the processor has the instructions.

/// Defines methods of a token, or of numbers that a token made, whose bodies are compiled for the given features.
///
/// In a body the features' intrinsics are safe, except those that read or write through pointers. The body of a
/// token's method cannot use `self`. The body of a method of numbers sees them under the name of the first argument.
macro_rules! proven {
    ($features:literal;) => {};
    (
        $features:literal;
        fn $name:ident(self $(, $argument:ident: $type:ty)*) $(-> $result:ty)? $body:block
        $($rest:tt)*
    ) => {
        #[inline(always)]
        fn $name(self $(, $argument: $type)*) $(-> $result)? {
            #[inline]
            #[target_feature(enable = $features)]
            fn compiled($($argument: $type),*) $(-> $result)? $body
            // SAFETY: a token is made only if the processor has these features
            unsafe { compiled($($argument),*) }
        }
        proven! { $features; $($rest)* }
    };
    (
        $features:literal;
        fn $name:ident($this:ident: $own:ty $(, $argument:ident: $type:ty)*) $(-> $result:ty)? $body:block
        $($rest:tt)*
    ) => {
        #[inline(always)]
        fn $name(self $(, $argument: $type)*) $(-> $result)? {
            #[inline]
            #[target_feature(enable = $features)]
            fn compiled($this: $own $(, $argument: $type)*) $(-> $result)? $body
            // SAFETY: only a token makes these numbers, if the processor has these features
            unsafe { compiled(self $(, $argument)*) }
        }
        proven! { $features; $($rest)* }
    };
}
pub(super) use proven;
